#include "messages.hpp"

#include <nanobind/stl/array.h>

// After Python's own header, on which it depends.
#include <structmember.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "errors.hpp"
#include "stamp.hpp"

namespace tfdb::python {
namespace {

/// A message's data of a lookup: target, source, seconds, nanoseconds, x y z qx qy qz qw.
constexpr std::size_t kValues = 11;
constexpr std::size_t kSeconds = 2;
constexpr std::size_t kNanoseconds = 3;
using Values = std::array<nb::object, kValues>;

nb::object checked(PyObject* made) {
    if (made == nullptr) {
        throw nb::python_error();
    }
    return nb::steal(made);
}

Values values_of(PyObject* target, PyObject* source, const Found& found) {
    Values values;
    values[0] = nb::borrow(target);
    values[1] = nb::borrow(source);
    values[kSeconds] = checked(PyLong_FromLongLong(found.stamp / clock::kNanosPerSecond));
    values[kNanoseconds] = checked(PyLong_FromLongLong(found.stamp % clock::kNanosPerSecond));
    const double* const numbers = &found.pose.translation.x;
    for (std::size_t i = 0; i < 7; ++i) {
        values[4 + i] = checked(PyFloat_FromDouble(numbers[i]));
    }
    return values;
}

nb::object call_with(const nb::object& make, PyObject* target, PyObject* source,
                     const Found& found) {
    const auto& [t, q] = found.pose;
    return make(nb::handle(target), nb::handle(source), found.stamp,
                nb::make_tuple(t.x, t.y, t.z, q.x, q.y, q.z, q.w));
}

/// One of a message's objects, and the content of its slots: another object, a constant, or a
/// value.
struct Part {
    struct Slot {
        Py_ssize_t offset = 0;
        std::unique_ptr<Part> part;
        nb::object constant;
        std::size_t value = 0;
    };
    nb::object type;
    std::vector<Slot> slots;
};

PyObject*& place_of(PyObject* object, Py_ssize_t offset) {
    return *reinterpret_cast<PyObject**>(reinterpret_cast<char*>(object) + offset);
}

/// Creates the object from the values; null with MemoryError.
PyObject* make_part(const Part& part, Values& values) {
    auto* const type = reinterpret_cast<PyTypeObject*>(part.type.ptr());
    PyObject* const made = PyType_GenericAlloc(type, 0);
    if (made == nullptr) {
        return nullptr;
    }
    for (const Part::Slot& slot : part.slots) {
        PyObject* held = nullptr;
        if (slot.part != nullptr) {
            held = make_part(*slot.part, values);
            if (held == nullptr) {
                Py_DECREF(made);
                return nullptr;
            }
        } else if (slot.constant.is_valid()) {
            held = Py_NewRef(slot.constant.ptr());
        } else {
            held = values[slot.value].release().ptr();
        }
        place_of(made, slot.offset) = held;
    }
    return made;
}

/// The offsets of a class's `__slots__` in its instances; empty if they hold anything else.
std::optional<std::vector<Py_ssize_t>> slots_of(PyTypeObject* type) {
    const nb::handle of_type(reinterpret_cast<PyObject*>(type));
    const auto size = [of_type](const char* name) {
        return nb::cast<Py_ssize_t>(of_type.attr(name));
    };
    if (PyType_GetSlot(type, Py_tp_alloc) != reinterpret_cast<void*>(PyType_GenericAlloc) ||
        PyType_GetSlot(type, Py_tp_new) != PyType_GetSlot(&PyBaseObject_Type, Py_tp_new) ||
        size("__itemsize__") != 0) {
        return std::nullopt;
    }
    std::vector<Py_ssize_t> offsets;
    for (const nb::handle base : of_type.attr("__mro__")) {
        const auto* member = static_cast<const PyMemberDef*>(
            PyType_GetSlot(reinterpret_cast<PyTypeObject*>(base.ptr()), Py_tp_members));
        for (; member != nullptr && member->name != nullptr; ++member) {
            if (member->type != T_OBJECT_EX || member->flags != 0) {
                return std::nullopt;
            }
            offsets.push_back(member->offset);
        }
    }
    std::sort(offsets.begin(), offsets.end());
    offsets.erase(std::unique(offsets.begin(), offsets.end()), offsets.end());
    const std::size_t others =
        (size("__dictoffset__") > 0 ? 1 : 0) + (size("__weakrefoffset__") > 0 ? 1 : 0);
    if (static_cast<std::size_t>(size("__basicsize__")) !=
        sizeof(PyObject) + (offsets.size() + others) * sizeof(PyObject*)) {
        return std::nullopt;
    }
    return offsets;
}

bool is_constant(PyObject* object) {
    return object == Py_None || PyBool_Check(object) || PyLong_CheckExact(object) ||
           PyFloat_CheckExact(object) || PyUnicode_CheckExact(object) || PyBytes_CheckExact(object);
}

bool are_equal(PyObject* a, PyObject* b) {
    if (Py_TYPE(a) != Py_TYPE(b)) {
        return false;
    }
    const int equal = PyObject_RichCompareBool(a, b, Py_EQ);
    if (equal < 0) {
        throw nb::python_error();
    }
    return equal == 1;
}

/// Takes a message with known values apart: each value must occur once.
class Reading {
public:
    explicit Reading(const Values& values) : values_(values) {}

    /// Null: the message cannot be created from its slots alone.
    std::unique_ptr<Part> read(PyObject* object, unsigned depth = 0) {
        constexpr unsigned kDeepest = 8;
        PyTypeObject* const type = Py_TYPE(object);
        const auto offsets = slots_of(type);
        if (!offsets || depth > kDeepest ||
            nb::len(nb::getattr(nb::handle(object), "__dict__", nb::tuple())) != 0) {
            return nullptr;
        }
        auto part = std::make_unique<Part>();
        part->type = nb::borrow(reinterpret_cast<PyObject*>(type));
        for (const Py_ssize_t offset : *offsets) {
            const nb::object held = nb::borrow(place_of(object, offset));
            if (held.is_valid() && !add_slot(*part, offset, held, depth)) {
                return nullptr;
            }
        }
        return part;
    }

    [[nodiscard]] bool whole() const {
        return std::all_of(times_.begin(), times_.end(), [](unsigned n) { return n == 1; });
    }

private:
    bool add_slot(Part& part, Py_ssize_t offset, const nb::object& held, unsigned depth) {
        Part::Slot& slot = part.slots.emplace_back();
        slot.offset = offset;
        if (!is_constant(held.ptr())) {
            slot.part = read(held.ptr(), depth + 1);
            return slot.part != nullptr;
        }
        for (std::size_t i = 0; i < kValues; ++i) {
            if (are_equal(values_[i].ptr(), held.ptr())) {
                slot.value = i;
                ++times_[i];
                return true;
            }
        }
        slot.constant = held;
        return true;
    }

    const Values& values_;
    std::array<unsigned, kValues> times_{};
};

bool are_same(const Part& a, const Part& b) {
    const auto same_slot = [](const Part::Slot& one, const Part::Slot& other) {
        if (one.offset != other.offset || one.value != other.value ||
            (one.part == nullptr) != (other.part == nullptr) ||
            one.constant.is_valid() != other.constant.is_valid()) {
            return false;
        }
        return one.part != nullptr       ? are_same(*one.part, *other.part)
               : one.constant.is_valid() ? are_equal(one.constant.ptr(), other.constant.ptr())
                                         : true;
    };
    return a.type.is(b.type) && a.slots.size() == b.slots.size() &&
           std::equal(a.slots.begin(), a.slots.end(), b.slots.begin(), same_slot);
}

/// How `make` creates its messages, derived from messages with recognisable values. Null if it does
/// more.
std::unique_ptr<Part> recipe_of(const nb::object& make) {
    std::unique_ptr<Part> found;
    for (const int which : {1, 2}) {  // parts that are equal in both do not depend on the values
        const double unusual = 1e-3 * which;
        const Found sample{{{11 + unusual, 12 + unusual, 13 + unusual},
                            {14 + unusual, 15 + unusual, 16 + unusual, 17 + unusual}},
                           (90'000 + which) * clock::kNanosPerSecond + 700'000 + which};
        const nb::str target(("target " + std::to_string(which)).c_str());
        const nb::str source(("source " + std::to_string(which)).c_str());
        const Values values = values_of(target.ptr(), source.ptr(), sample);
        Reading reading(values);
        const nb::object made = call_with(make, target.ptr(), source.ptr(), sample);
        std::unique_ptr<Part> part = reading.read(made.ptr());
        if (part == nullptr || !reading.whole() || (found != nullptr && !are_same(*found, *part))) {
            return nullptr;
        }
        found = std::move(part);
    }
    return found;
}

/// Where the messages' stamp class stores its numbers; no class if unknown.
struct TimeSlots {
    PyTypeObject* type = nullptr;
    Py_ssize_t seconds = 0;
    Py_ssize_t nanoseconds = 0;
};

TimeSlots time_slots_in(const Part& part) {
    TimeSlots found;
    for (const Part::Slot& slot : part.slots) {
        if (slot.part != nullptr) {
            if (const TimeSlots inner = time_slots_in(*slot.part); inner.type != nullptr) {
                return inner;
            }
        } else if (slot.value == kSeconds) {
            found.seconds = slot.offset;
        } else if (slot.value == kNanoseconds) {
            found.nanoseconds = slot.offset;
        }
    }
    if (found.seconds != 0 && found.nanoseconds != 0) {
        found.type = reinterpret_cast<PyTypeObject*>(part.type.ptr());
    }
    return found;
}

int traverse_part(const Part& part, visitproc visit, void* arg) {
    Py_VISIT(part.type.ptr());
    for (const Part::Slot& slot : part.slots) {
        Py_VISIT(slot.constant.ptr());
        if (slot.part != nullptr) {
            if (const int result = traverse_part(*slot.part, visit, arg); result != 0) {
                return result;
            }
        }
    }
    return 0;
}

/// The object behind the Python class: the function, and its recipe once it was derived.
/// Threads: the holder of the GIL; without a GIL, any.
/// Guarantee: a recipe is never replaced, so it may be used concurrently.
class MessageMaker {
public:
    explicit MessageMaker(nb::object make) : make_(std::move(make)) {}

    [[nodiscard]] const nb::object& function() const { return make_; }

    /// Null: `make` must be called. Runs Python code the first time.
    const Part* recipe(PyObject* self) {
        const auto known = [&] {
            const nb::ft_object_guard guard(self);
            return looked_for_;
        };
        if (!known()) [[unlikely]] {
            std::unique_ptr<Part> found = recipe_of(make_);
            const nb::ft_object_guard guard(self);
            if (!std::exchange(looked_for_, true) && found != nullptr) {
                recipe_ = std::move(found);
                time_ = time_slots_in(*recipe_);
            }
        }
        return recipe_.get();
    }

    /// For stamps of that class: their numbers can be read in place.
    [[nodiscard]] const TimeSlots& time() const { return time_; }

    int traverse(visitproc visit, void* arg) const {
        Py_VISIT(make_.ptr());
        return recipe_ == nullptr ? 0 : traverse_part(*recipe_, visit, arg);
    }

private:
    nb::object make_;
    std::unique_ptr<Part> recipe_;
    TimeSlots time_;
    bool looked_for_ = false;
};

nb::object call(nb::handle self, nb::handle target, nb::handle source, nb::handle stamp,
                nb::handle pose) {
    const std::optional<std::int64_t> plain = plain_nanoseconds(stamp.ptr());
    std::array<double, 7> numbers{};
    if (!plain || !PyUnicode_CheckExact(target.ptr()) || !PyUnicode_CheckExact(source.ptr()) ||
        !nb::try_cast(pose, numbers)) {
        return nb::inst_ptr<MessageMaker>(self)->function()(target, source, stamp, pose);
    }
    Found found;
    found.stamp = *plain;
    std::copy(numbers.begin(), numbers.end(), &found.pose.translation.x);
    return checked(make_message(self.ptr(), target.ptr(), source.ptr(), found));
}

// A function may refer to objects that hold its maker: this shows the garbage collector the
// reference. Functions and classes clear their own references, so there is nothing to clear here.
int traverse(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    return nb::inst_ready(self) ? nb::inst_ptr<MessageMaker>(self)->traverse(visit, arg) : 0;
}

PyType_Slot g_slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse)},
    {0, nullptr},
};

}  // namespace

bool is_message_maker(nb::handle object) {
    return nb::isinstance<MessageMaker>(object) && nb::inst_ready(object);
}

std::optional<std::int64_t> message_time(PyObject* maker, PyObject* time) {
#ifndef Py_GIL_DISABLED  // without the GIL another thread may be setting a slot
    const TimeSlots& slots = nb::inst_ptr<MessageMaker>(maker)->time();
    if (Py_IS_TYPE(time, slots.type) != 0) {
        return plain_nanoseconds(place_of(time, slots.seconds), place_of(time, slots.nanoseconds));
    }
#else
    static_cast<void>(maker);
#endif
    return plain_nanoseconds(time);
}

PyObject* make_message(PyObject* maker, PyObject* target, PyObject* source, const Found& found) {
    return guarded([&]() -> PyObject* {
        constexpr StampNs kAfter = (StampNs{1} << 31) * clock::kNanosPerSecond;
        MessageMaker& object = *nb::inst_ptr<MessageMaker>(maker);
        const Part* const recipe = object.recipe(maker);
        // Messages whose seconds have 31 bits refuse later stamps, and ROS 1 messages refuse
        // negative ones.
        if (recipe == nullptr || found.stamp < 0 || found.stamp >= kAfter) [[unlikely]] {
            return call_with(object.function(), target, source, found).release().ptr();
        }
        Values values = values_of(target, source, found);
        return make_part(*recipe, values);
    });
}

void bind_messages(nb::module_& module) {
    nb::class_<MessageMaker> type(module, "MessageMaker",
                                  R"(Makes the same messages as a Python function, faster.

It calls the function twice, and reads from the two messages the classes of their objects, and the
slots that hold the arguments. If the messages have other parts than objects with `__slots__`, it
calls the function each time.

Parameters
----------
make
    Makes a message of a target, a source, a stamp in nanoseconds and a pose x y z qx qy qz qw.)",
                                  nb::type_slots(g_slots));
    type.def(nb::init<nb::object>(), nb::arg("make"),
             nb::sig("def __init__(self, make: collections.abc.Callable[[str, str, int, "
                     "collections.abc.Sequence[float]], typing.Any]) -> None"));
    type.def("__call__", &call, nb::arg("target"), nb::arg("source"), nb::arg("stamp"),
             nb::arg("pose"),
             nb::sig("def __call__(self, target: str, source: str, stamp: int, pose: "
                     "collections.abc.Sequence[float]) -> typing.Any"),
             "A message T[target<-source]. Raises what the function raises.");
    type.def_prop_ro(
        "is_quick",
        [](nb::handle self) {
            return nb::inst_ptr<MessageMaker>(self)->recipe(self.ptr()) != nullptr;
        },
        nb::sig("def is_quick(self) -> bool"), "Whether the function need not be called.");
}

}  // namespace tfdb::python
