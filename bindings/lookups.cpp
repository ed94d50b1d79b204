// The hottest reads as raw methods: lookup_transform, lookup_latest_transform, can_transform.
#include <array>
#include <chrono>

#include "arguments.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "stamp.hpp"
#include "transform.hpp"

namespace tfdb::python {
namespace {

// One for each thread that may be inside a lookup; no Python code runs while it is in use.
#ifdef Py_GIL_DISABLED
thread_local
#endif
    Answer g_answer;

/// `self` of a raw method, readable until the end of the call.
class Open {
public:
#ifdef Py_GIL_DISABLED
    explicit Open(PyObject* self) : object_(reads_of(self)), pinned_(pin(self, object_)) {}
#else
    explicit Open(PyObject* self) : object_(reads_of(self)) {
        if (object_.reads == nullptr) {
            throw_closed(object_);
        }
    }
#endif

    [[nodiscard]] const Reads& reads() const {
#ifdef Py_GIL_DISABLED
        return pinned_.reads;
#else
        return *object_.reads;
#endif
    }
    [[nodiscard]] NameCache& names() const {
        return *object_.names;
    }
    [[nodiscard]] PyObject* buffer() const {
        return object_.buffer;
    }

private:
    ReadsObject& object_;
#ifdef Py_GIL_DISABLED
    Pinned pinned_;
#endif
};

/// Calls `attempt(target, source)` until neither handle turns out to be out of date: afterwards, as
/// a slot that was not reused by then was not reused before.
template <class Attempt>
bool with_handles(const Open& open, PyObject* target, PyObject* source, const Failure& failure,
                  Attempt&& attempt) {
    constexpr int kMostTries = 16;
    const Reads& reads = open.reads();
    NameCache& names = open.names();
    FrameHandle to = names.find(reads, target, "target");
    FrameHandle from = names.find(reads, source, "source");
    const auto settled = [&](FrameHandle handle) {
        return handle.id == kNoFrame || reads.is_current(handle);
    };
    bool anew = !NameCache::kRemembers;
    for (int i = 0;; ++i) {
        const bool found = attempt(to, from);
        const bool certain = found || anew || failure.code != ErrorCode::kUnknownFrame;
        if ((certain && settled(to) && settled(from)) || i == kMostTries) [[likely]] {
            return found;
        }
        to = names.renew(reads, target, "target");
        from = names.renew(reads, source, "source");
        anew = true;
    }
}

[[noreturn]] void raise(const Open& open, const Failure& failure, PyObject* target,
                        PyObject* source) {
    open.reads().raise(failure, name_of(target, "target"), name_of(source, "source"));
}

bool attempt_lookup(const Open& open, PyObject* target, PyObject* source, PyObject* time,
                    PyObject* policy, Failure& failure) {
    const std::optional<StampNs> stamp = optional_stamp_of(time);
    const Policy how = policy_of(policy);
    return with_handles(open, target, source, failure, [&](FrameHandle to, FrameHandle from) {
        return open.reads().try_lookup(to, from, stamp, how, g_answer, failure);
    });
}

constexpr std::array kLookupNames = {"target", "source", "time", "policy"};
constexpr std::array kLatestNames = {"target", "source", "max_age", "now"};

PyObject* lookup_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                           PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"lookup_transform", kLookupNames, 2, 4};
        const auto [target, source, time, policy] = bind<4>(kList, args, count, keywords);
        const Open open(self);
        Failure failure;
        if (!attempt_lookup(open, target, source, time, policy, failure)) {
            raise(open, failure, target, source);
        }
        return new_transform(g_answer, target, source, open.buffer());
    });
}

PyObject* can_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                        PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"can_transform", kLookupNames, 2, 4};
        const auto [target, source, time, policy] = bind<4>(kList, args, count, keywords);
        const Open open(self);
        Failure failure;
        const bool can = attempt_lookup(open, target, source, time, policy, failure);
        if (!can && failure.code == ErrorCode::kSnapshotTooOld) {
            raise(open, failure, target, source);
        }
        return PyBool_FromLong(can ? 1 : 0);
    });
}

StampNs now_of(const Open& open) {
    const nb::object& clock = nb::inst_ptr<BufferObject>(open.buffer())->clock;
    if (clock.is_valid()) {
        return stamp_of(nb::object(clock()).ptr());
    }
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

PyObject* lookup_latest_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                                  PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"lookup_latest_transform", kLatestNames, 2, 4};
        const auto [target, source, age, when] = bind<4>(kList, args, count, keywords);
        const Open open(self);
        std::optional<StampNs> max_age;
        StampNs now = 0;
        if (is_given(age)) {
            max_age = duration_of(age, "max_age");
            now = is_given(when) ? stamp_of(when) : now_of(open);
        }
        Failure failure;
        const bool found =
            with_handles(open, target, source, failure, [&](FrameHandle to, FrameHandle from) {
                return open.reads().try_lookup_latest(to, from, max_age, now, g_answer, failure);
            });
        if (!found) {
            raise(open, failure, target, source);
        }
        return new_transform(g_answer, target, source, open.buffer());
    });
}

PyMethodDef g_methods[] = {
    {"lookup_transform", as_function(lookup_transform), METH_FASTCALL | METH_KEYWORDS,
     "lookup_transform($self, target, source, time=None, policy=None)\n--\n\n"
     "T[target<-source] at a stamp: maps points of `source` into `target`.\n\n"
     "Parameters\n----------\n"
     "target, source\n    Frame names.\n"
     "time\n    Stamp in nanoseconds (or an object that holds one). None: the latest common time,\n"
     "    at which every moving edge of the path has data.\n"
     "policy\n    How a stamp between samples is answered. None: Interpolate().\n\n"
     "Returns\n-------\nTransform\n    With a report of the samples that were used.\n\n"
     "Raises\n------\n"
     "UnknownFrame, Disconnected, Extrapolation, GapTooLarge, Stale, NoSampleNear, InvalidStamp,\n"
     "SnapshotTooOld, SnapshotClosed"},
    {"lookup_latest_transform", as_function(lookup_latest_transform), METH_FASTCALL | METH_KEYWORDS,
     "lookup_latest_transform($self, target, source, max_age=None, now=None)\n--\n\n"
     "T[target<-source] from each edge's own newest sample; nothing is interpolated.\n\n"
     "Parameters\n----------\n"
     "target, source\n    Frame names.\n"
     "max_age\n    Seconds. An edge whose newest sample is older than `now - max_age` is refused.\n"
     "now\n    Stamp in nanoseconds; None asks the buffer's clock.\n\n"
     "Returns\n-------\nTransform\n    Its stamp is the oldest of the stamps used, 0 if nothing moves.\n\n"
     "Raises\n------\nUnknownFrame, Disconnected, Extrapolation (an edge has no data), Stale,\n"
     "InvalidStamp, InvalidArgument, SnapshotTooOld, SnapshotClosed"},
    {"can_transform", as_function(can_transform), METH_FASTCALL | METH_KEYWORDS,
     "can_transform($self, target, source, time=None, policy=None)\n--\n\n"
     "Whether `lookup_transform` with these arguments has an answer. Cheap also when it has none.\n\n"
     "Raises\n------\nInvalidStamp, SnapshotTooOld, SnapshotClosed"},
};

}  // namespace

void add_raw_reads(nb::handle type) {
    for (PyMethodDef& method : g_methods) {
        const nb::object descriptor =
            nb::steal(PyDescr_NewMethod(reinterpret_cast<PyTypeObject*>(type.ptr()), &method));
        nb::setattr(type, method.ml_name, descriptor);
    }
}

}  // namespace tfdb::python
