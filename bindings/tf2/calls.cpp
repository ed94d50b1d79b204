// The most frequent calls of tfdb.tf2, as base classes of its BufferCore and Buffer. Each handles
// plain arguments, and passes all others to a Python method of the same name with a leading
// underscore. The Python methods contain the rules of tf2.
#include "tf2/calls.hpp"

#include <array>
#include <optional>
#include <string_view>
#include <utility>

#include "arguments.hpp"
#include "errors.hpp"
#include "fields.hpp"
#include "messages.hpp"
#include "pose.hpp"
#include "reads.hpp"
#include "stamp.hpp"
#include "writes.hpp"

namespace tfdb::python {
namespace {

/// The settings for an object's native calls, set by `_answer_by`; null before.
struct Plain {
    PyObject* buffer = nullptr;
    PyObject* maker = nullptr;
    PyObject* only_time = nullptr;  // the one time class accepted besides int; null: any
    WriteRules rules;
    bool own_lookup = false;  // no subclass overrides lookup_transform_core ...
    bool own_can = false;     // ... or can_transform_core
};

void release(const Plain& plain) {
    Py_XDECREF(plain.buffer);
    Py_XDECREF(plain.maker);
    Py_XDECREF(plain.only_time);
}

/// Threads: any; with the GIL where there is one. Guarantee: none beyond that.
struct CoreObject {
    PyObject_HEAD Plain plain;
};

CoreObject& core_of(PyObject* self) {
    return *reinterpret_cast<CoreObject*>(self);
}

/// The same for one call; keeps its objects alive meanwhile.
class Using {
public:
    explicit Using(PyObject* self) {
        const nb::ft_object_guard guard(self);
        plain_ = core_of(self).plain;
        buffer_ = nb::borrow(plain_.buffer);
        maker_ = nb::borrow(plain_.maker);
        only_time_ = nb::borrow(plain_.only_time);
    }

    [[nodiscard]] const Plain& operator*() const { return plain_; }
    [[nodiscard]] const Plain* operator->() const { return &plain_; }
    [[nodiscard]] explicit operator bool() const { return plain_.buffer != nullptr; }

    /// Nanoseconds of a plain time.
    [[nodiscard]] std::optional<StampNs> stamp(PyObject* time) const {
        if (PyLong_CheckExact(time) == 0 && plain_.only_time != nullptr &&
            reinterpret_cast<PyObject*>(Py_TYPE(time)) != plain_.only_time) {
            return std::nullopt;
        }
        const std::optional<std::int64_t> found = message_time(plain_.maker, time);
        return found && clock::is_stamp(*found) ? found : std::nullopt;
    }

    /// The stamp of a plain question.
    [[nodiscard]] std::optional<StampNs> asked(PyObject* target, PyObject* source,
                                               PyObject* time) const {
        const bool named = PyUnicode_CheckExact(target) && PyUnicode_CheckExact(source);
        return named ? stamp(time) : std::nullopt;
    }

    /// Whether a plain question has an answer.
    [[nodiscard]] bool can(PyObject* target, PyObject* source, StampNs at) const {
        return can_find_pose(plain_.buffer, target, source, stamp_or_latest(at));
    }

    /// The answer as a message, a new reference. Null if the question is not plain or has no
    /// answer, or with a Python error.
    [[nodiscard]] PyObject* message(PyObject* target, PyObject* source, PyObject* time) const {
        const std::optional<StampNs> at = asked(target, source, time);
        const std::optional<Found> found =
            at ? find_pose(plain_.buffer, target, source, stamp_or_latest(*at)) : std::nullopt;
        return found ? make_message(plain_.maker, target, source, *found) : nullptr;
    }

private:
    /// Time 0 is the latest common time.
    static std::optional<StampNs> stamp_or_latest(StampNs at) {
        return at == 0 ? std::nullopt : std::optional(at);
    }

    Plain plain_;
    nb::object buffer_;
    nb::object maker_;
    nb::object only_time_;
};

/// A number is seconds; the Python method refuses invalid durations.
bool is_plain_timeout(PyObject* timeout) {
    if (!is_given(timeout)) {
        return true;
    }
    const bool is_float = PyFloat_CheckExact(timeout);
    const auto whole = is_float ? std::nullopt : plain_nanoseconds(timeout);
    if (!is_float && (!whole || !PyLong_CheckExact(timeout))) {
        return whole.has_value();
    }
    const double seconds = is_float ? PyFloat_AsDouble(timeout) : static_cast<double>(*whole);
    return seconds >= 0.0 && clock::nanoseconds_from_seconds(seconds).has_value();
}

/// Clears the error of a plain answer: the Python method raises it.
void forget(nb::python_error& error) {
    if (!error.matches(PyExc_Exception) || error.matches(PyExc_MemoryError)) {
        throw nb::python_error(std::move(error));
    }
}

/// Returns the result of `answer`; if that is null or throws, calls the Python method with the
/// arguments.
template <class Answer, std::size_t N>
PyObject* answer_or_call(PyObject* self, PyObject* method, const std::array<PyObject*, N>& given,
                         Answer&& answer) {
    try {
        if (const Using plain(self); plain) [[likely]] {
            if (PyObject* const made = answer(plain); made != nullptr) [[likely]] {
                return made;
            }
            if (PyErr_Occurred() != nullptr) {
                return nullptr;
            }
        }
    } catch (nb::python_error& error) {
        forget(error);
    } catch (const LockTimeout&) {
        throw;  // a retry would wait again
    } catch (const Error&) {
    }
    std::array<PyObject*, N + 1> all{self};
    for (std::size_t i = 0; i < N; ++i) {
        all[i + 1] = given[i] == nullptr ? Py_None : given[i];
    }
    return PyObject_VectorcallMethod(method, all.data(), all.size(), nullptr);
}

constexpr std::array<std::string_view, 3> kCoreNames = {"target_frame", "source_frame", "time"};
constexpr std::array<std::string_view, 5> kBufferNames = {"target_frame", "source_frame", "time",
                                                          "timeout", "return_debug_tuple"};
constexpr std::array<std::string_view, 2> kSetNames = {"transform", "authority"};
constexpr std::array<std::string_view, 5> kAnswerNames = {"buffer", "maker", "only_time",
                                                          "change_kind", "only_new"};

/// Names looked up in each call, interned once.
struct Methods {
    PyObject* lookup_transform_core = nullptr;
    PyObject* can_transform_core = nullptr;
    PyObject* slow_lookup_transform_core = nullptr;
    PyObject* slow_can_transform_core = nullptr;
    PyObject* slow_lookup_transform = nullptr;
    PyObject* slow_can_transform = nullptr;
    PyObject* slow_set_transform = nullptr;
    PyObject* why_not = nullptr;
    PyObject* yes = nullptr;  // (1, "")
};
Methods g_methods;
PyTypeObject* g_core_calls = nullptr;

PyObject* lookup_transform_core(PyObject* self, PyObject* const* args, Py_ssize_t count,
                                PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"lookup_transform_core", kCoreNames, 3, 3};
        const auto given = bind<3>(kList, args, count, keywords);
        return answer_or_call(self, g_methods.slow_lookup_transform_core, given,
                              [&](const Using& plain) -> PyObject* {
                                  return plain.message(given[0], given[1], given[2]);
                              });
    });
}

PyObject* can_transform_core(PyObject* self, PyObject* const* args, Py_ssize_t count,
                             PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"can_transform_core", kCoreNames, 3, 3};
        const auto given = bind<3>(kList, args, count, keywords);
        const auto [target, source, time] = given;
        return answer_or_call(
            self, g_methods.slow_can_transform_core, given, [&](const Using& plain) -> PyObject* {
                const std::optional<StampNs> at = plain.asked(target, source, time);
                if (!at) {
                    return nullptr;
                }
                if (plain.can(target, source, *at)) {
                    return Py_NewRef(g_methods.yes);
                }
                const nb::object stamp = nb::int_(*at);
                return PyObject_CallMethodObjArgs(self, g_methods.why_not, target, source,
                                                  stamp.ptr(), nullptr);
            });
    });
}

PyObject* lookup_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                           PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"lookup_transform", {kBufferNames.data(), 4}, 3, 4};
        const auto given = bind<4>(kList, args, count, keywords);
        return answer_or_call(self, g_methods.slow_lookup_transform, given,
                              [&](const Using& plain) -> PyObject* {
                                  return plain->own_lookup && is_plain_timeout(given[3])
                                             ? plain.message(given[0], given[1], given[2])
                                             : nullptr;
                              });
    });
}

PyObject* can_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                        PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"can_transform", kBufferNames, 3, 5};
        const auto given = bind<5>(kList, args, count, keywords);
        return answer_or_call(self, g_methods.slow_can_transform, given,
                              [&](const Using& plain) -> PyObject* {
                                  if (!plain->own_can || !is_plain_timeout(given[3]) ||
                                      (given[4] != nullptr && given[4] != Py_False)) {
                                      return nullptr;
                                  }
                                  const auto at = plain.asked(given[0], given[1], given[2]);
                                  const bool can = at && plain.can(given[0], given[1], *at);
                                  if (!at || (!can && is_given(given[3]))) {
                                      return nullptr;  // the answer may still arrive
                                  }
                                  return PyLong_FromLong(can ? 1 : 0);  // as in tf2
                              });
    });
}

/// A name without the leading slash of old tf2 versions.
std::string_view frame_of(const nb::object& name) {
    std::string_view text = name_of(name, "frame");
    if (text.starts_with('/')) {
        text.remove_prefix(1);
    }
    return text;
}

PyObject* store_message(const Using& plain, PyObject* message, PyObject* authority) {
    BufferObject& buffer = *nb::inst_ptr<BufferObject>(plain->buffer);
    if (!PyUnicode_CheckExact(authority) || buffer.waits_begun.load(std::memory_order_relaxed)) {
        return nullptr;
    }
    const nb::object header = get(message, g_fields.header);
    const nb::object transform = get(message, g_fields.transform);
    const nb::object parent = get(header.ptr(), g_fields.frame_id);
    const nb::object child = get(message, g_fields.child_frame_id);
    const nb::object translation = get(transform.ptr(), g_fields.translation);
    const nb::object rotation = get(transform.ptr(), g_fields.rotation);
    const std::optional<StampNs> stamp = plain.stamp(get(header.ptr(), g_fields.stamp).ptr());
    if (!stamp) {
        return nullptr;
    }
    const TransformView view{
        frame_of(parent),
        frame_of(child),
        *stamp,
        {vector_of(translation.ptr(), "translation"), quaternion_of(rotation.ptr(), "rotation")}};
    commit_write(buffer, {.transforms = {&view, 1},
                          .authority = name_of(authority, "authority"),
                          .rules = plain->rules});
    return Py_NewRef(Py_None);
}

PyObject* set_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                        PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"set_transform", kSetNames, 2, 2};
        const auto given = bind<2>(kList, args, count, keywords);
        return answer_or_call(self, g_methods.slow_set_transform, given, [&](const Using& plain) {
            return store_message(plain, given[0], given[1]);
        });
    });
}

/// Whether a class inherits tfdb's own method, without an override.
bool has_ours(PyObject* self, PyObject* name) {
    const nb::object ours = get(reinterpret_cast<PyObject*>(g_core_calls), name);
    return get(reinterpret_cast<PyObject*>(Py_TYPE(self)), name).is(ours);
}

PyObject* answer_by(PyObject* self, PyObject* const* args, Py_ssize_t count, PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"_answer_by", kAnswerNames, 5, 3};
        const auto [buffer, maker, only_time, change_kind, only_new] =
            bind<5>(kList, args, count, keywords);
        Plain plain;
        // The behaviour of a subclass of Buffer is unknown.
        if (nb::handle(Py_TYPE(buffer)).is(offered_type<BufferObject>()) &&
            nb::inst_ready(buffer) && is_message_maker(maker)) {
            plain.buffer = Py_NewRef(buffer);
            plain.maker = Py_NewRef(maker);
            plain.only_time = only_time == Py_None ? nullptr : Py_NewRef(only_time);
            plain.rules = {change_kind == Py_True, only_new == Py_True};
            plain.own_lookup = has_ours(self, g_methods.lookup_transform_core);
            plain.own_can = has_ours(self, g_methods.can_transform_core);
        }
        {
            const nb::ft_object_guard guard(self);
            std::swap(plain, core_of(self).plain);
        }
        release(plain);
        Py_RETURN_NONE;
    });
}

int traverse(PyObject* self, visitproc visit, void* arg) {
    const Plain& plain = core_of(self).plain;
    Py_VISIT(Py_TYPE(self));
    Py_VISIT(plain.buffer);
    Py_VISIT(plain.maker);
    Py_VISIT(plain.only_time);
    return 0;
}

int clear(PyObject* self) {
    release(std::exchange(core_of(self).plain, {}));
    return 0;
}

void deallocate(PyObject* self) {
    PyTypeObject* const type = Py_TYPE(self);
    PyObject_GC_UnTrack(self);
    clear(self);
    PyObject_GC_Del(self);
    Py_DECREF(type);
}

constexpr const char* kLookupCoreDoc =
    "lookup_transform_core($self, target_frame, source_frame, time)\n--\n\n"
    "T[target_frame<-source_frame] at a time: maps points of the source into the target.\n\n"
    "Parameters\n----------\n"
    "target_frame, source_frame\n    Frame names.\n"
    "time\n    When; 0: the latest common time.\n\n"
    "Returns\n-------\ngeometry_msgs.msg.TransformStamped\n"
    "    Its stamp is the time, or the latest common time.\n\n"
    "Raises LookupException, ConnectivityException, ExtrapolationException,\n"
    "InvalidArgumentException; TypeError for an invalid time.";

constexpr const char* kCanCoreDoc =
    "can_transform_core($self, target_frame, source_frame, time)\n--\n\n"
    "Whether `lookup_transform_core` succeeds: (1, '') or (0, reason).\n\n"
    "Raises TypeError for an invalid time or name.";

constexpr const char* kSetDoc =
    "set_transform($self, transform, authority)\n--\n\n"
    "Store T[header.frame_id<-child_frame_id] at header.stamp.\n\n"
    "One leading '/' of each frame name is dropped. Refused transforms are logged\n"
    "(logger `tfdb.tf2`) with tf2's text. A repeated stamp keeps its first value in ROS 1, and\n"
    "its last in ROS 2. A static frame stays static in ROS 1, and becomes moving in ROS 2.\n\n"
    "Parameters\n----------\n"
    "transform\n    A `geometry_msgs/TransformStamped` of any library.\n"
    "authority\n    Name of the writer.\n\n"
    "Raises TypeError for other messages. Errors of the store itself are raised as by\n"
    "`tfdb.Buffer`: CapacityExceeded, ReadOnly, LockTimeout.";

constexpr const char* kLookupDoc =
    "lookup_transform($self, target_frame, source_frame, time, timeout=None)\n--\n\n"
    "Wait for T[target_frame<-source_frame] at a time, and return it.\n\n"
    "Parameters\n----------\n"
    "target_frame, source_frame\n    Frame names.\n"
    "time\n    When; 0: the latest common time.\n"
    "timeout\n    Longest wait: a duration, or seconds as a float.\n\n"
    "Returns\n-------\ngeometry_msgs.msg.TransformStamped\n"
    "    Maps points of the source into the target: p_target = T p_source.\n\n"
    "Raises the errors of `lookup_transform_core` at the end of the timeout;\n"
    "InvalidArgumentException at once.";

constexpr const char* kCanDoc =
    "can_transform($self, target_frame, source_frame, time, timeout=None, "
    "return_debug_tuple=False)\n--\n\n"
    "Whether `lookup_transform` succeeds within the timeout.\n\n"
    "`return_debug_tuple`: return (result, reason). Arguments as in `lookup_transform`.";

PyMethodDef g_core_methods[] = {
    {"lookup_transform_core", as_function(lookup_transform_core), METH_FASTCALL | METH_KEYWORDS,
     kLookupCoreDoc},
    {"can_transform_core", as_function(can_transform_core), METH_FASTCALL | METH_KEYWORDS,
     kCanCoreDoc},
    {"set_transform", as_function(set_transform), METH_FASTCALL | METH_KEYWORDS, kSetDoc},
    {"_answer_by", as_function(answer_by), METH_FASTCALL | METH_KEYWORDS,
     "_answer_by($self, buffer, maker, only_time, *, change_kind, only_new)\n--\n\n"
     "Run simple calls natively from now on.\n\n"
     "Parameters\n----------\n"
     "buffer\n    The store. With a subclass of `Buffer`, all calls run in Python.\n"
     "maker\n    Makes the messages that lookups return.\n"
     "only_time\n    The only class of times, beside int, that runs natively. None: any class.\n"
     "change_kind, only_new\n    As in `Buffer.set_transform`."},
    {nullptr, nullptr, 0, nullptr},
};

PyMethodDef g_buffer_methods[] = {
    {"lookup_transform", as_function(lookup_transform), METH_FASTCALL | METH_KEYWORDS, kLookupDoc},
    {"can_transform", as_function(can_transform), METH_FASTCALL | METH_KEYWORDS, kCanDoc},
    {nullptr, nullptr, 0, nullptr},
};

constexpr const char* kCoreDoc =
    "Native versions of the most used calls of `tfdb.tf2.BufferCore`.\n\n"
    "Simple calls run natively. Others call the Python method of the same name with an\n"
    "underscore.";

constexpr const char* kBufferDoc =
    "Native versions of the most used calls of `tfdb.tf2.Buffer`, as `CoreCalls` of\n"
    "`BufferCore`.\n\n"
    "If a subclass overrides `lookup_transform_core` or `can_transform_core`, the Python methods\n"
    "run.";

PyType_Slot g_core_slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse)},
    {Py_tp_clear, reinterpret_cast<void*>(clear)},
    {Py_tp_dealloc, reinterpret_cast<void*>(deallocate)},
    {Py_tp_methods, g_core_methods},
    {Py_tp_doc, const_cast<char*>(kCoreDoc)},
    {0, nullptr},
};

PyType_Slot g_buffer_slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse)},
    {Py_tp_clear, reinterpret_cast<void*>(clear)},
    {Py_tp_dealloc, reinterpret_cast<void*>(deallocate)},
    {Py_tp_methods, g_buffer_methods},
    {Py_tp_doc, const_cast<char*>(kBufferDoc)},
    {0, nullptr},
};

constexpr unsigned kFlags =
    Py_TPFLAGS_DEFAULT | Py_TPFLAGS_BASETYPE | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_IMMUTABLETYPE;
PyType_Spec g_core_spec = {"tfdb.tf2.CoreCalls", sizeof(CoreObject), 0, kFlags, g_core_slots};
PyType_Spec g_buffer_spec = {"tfdb.tf2.BufferCalls", sizeof(CoreObject), 0, kFlags, g_buffer_slots};

PyObject* interned(const char* name) {
    PyObject* const made = PyUnicode_InternFromString(name);
    if (made == nullptr) {
        throw nb::python_error();
    }
    return made;
}

nb::object made_type(PyType_Spec& spec, PyObject* base) {
    PyObject* const type = PyType_FromSpecWithBases(&spec, base);
    if (type == nullptr) {
        throw nb::python_error();
    }
    return nb::steal(type);
}

}  // namespace

void bind_tf2_calls(nb::module_& module) {
    g_methods.lookup_transform_core = interned("lookup_transform_core");
    g_methods.can_transform_core = interned("can_transform_core");
    g_methods.slow_lookup_transform_core = interned("_lookup_transform_core");
    g_methods.slow_can_transform_core = interned("_can_transform_core");
    g_methods.slow_lookup_transform = interned("_lookup_transform");
    g_methods.slow_can_transform = interned("_can_transform");
    g_methods.slow_set_transform = interned("_set_transform");
    g_methods.why_not = interned("_why_not");
    g_methods.yes = nb::make_tuple(1, "").release().ptr();
    const nb::object core = made_type(g_core_spec, nullptr);
    g_core_calls = reinterpret_cast<PyTypeObject*>(core.inc_ref().ptr());
    module.attr("CoreCalls") = core;
    module.attr("BufferCalls") = made_type(g_buffer_spec, core.ptr());
}

}  // namespace tfdb::python
