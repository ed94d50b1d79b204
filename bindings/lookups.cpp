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
// For lookups without the GIL: what is local to a thread is slower to reach.
thread_local Answer g_own_answer;

/// `self` of a raw method, readable until the end of the call. To be made when no Python code will
/// run any more, but after `keep`: else a snapshot that the GIL protects could be closed meanwhile.
class Open {
public:
    explicit Open(PyObject* self) : object_(made_reads(self)) {
        const nb::ft_object_guard guard(self);
        reads_ = object_.reads;
        if (reads_ == nullptr) {
            throw_closed(object_);
        }
        may_wait_ = false;
        if (!object_.waits->none()) [[unlikely]] {
            check_not_in_transaction(object_);
            may_wait_ = object_.waits->to_wait();
        }
        if (may_wait_ || kWithoutGil) {
            keep();
        }
    }

    /// Keeps a snapshot readable from here on also where Python code runs.
    void keep() { keep_ = object_.held; }

    [[nodiscard]] const Reads& reads() const { return *reads_; }
    [[nodiscard]] NameCache& names() const { return *object_.names; }
    [[nodiscard]] PathNames& paths() const { return *object_.paths; }
    /// Whether the GIL must not be kept.
    [[nodiscard]] bool may_wait() const { return may_wait_; }

private:
#ifdef Py_GIL_DISABLED
    static constexpr bool kWithoutGil = true;
#else
    static constexpr bool kWithoutGil = false;
#endif

    const ReadsObject& object_;
    const Reads* reads_;
    bool may_wait_;
    std::shared_ptr<Snapshot> keep_;
};

/// Calls `attempt(target, source, answer)` until neither handle turns out to be out of date:
/// afterwards, as a slot that was not reused by then was not reused before. Null: no answer.
template <class Attempt>
const Answer* look_up(const Open& open, PyObject* target, PyObject* source, const Failure& failure,
                      Attempt&& attempt) {
    constexpr int kMostTries = 16;
    const Reads& reads = open.reads();
    NameCache& names = open.names();
    const bool may_wait = open.may_wait();
    Answer& answer = may_wait ? g_own_answer : g_answer;
    FrameHandle to = names.find(reads, target, "target", may_wait);
    FrameHandle from = names.find(reads, source, "source", may_wait);
    const auto settled = [&](FrameHandle handle) {
        return handle.id == kNoFrame || reads.is_current(handle);
    };
    bool anew = !NameCache::kRemembers;
    for (int i = 0;; ++i) {
        bool found = false;
        if (may_wait) [[unlikely]] {
            const nb::gil_scoped_release released;
            found = attempt(to, from, answer);
        } else {
            found = attempt(to, from, answer);
        }
        const bool certain = found || anew || failure.code != ErrorCode::kUnknownFrame;
        if ((certain && settled(to) && settled(from)) || i == kMostTries) [[likely]] {
            return found ? &answer : nullptr;
        }
        to = names.renew(reads, target, "target", may_wait);
        from = names.renew(reads, source, "source", may_wait);
        anew = true;
    }
}

[[noreturn]] void raise(const Open& open, const Failure& failure, PyObject* target,
                        PyObject* source) {
    const std::string_view to = name_of(target, "target");
    const std::string_view from = name_of(source, "source");
    const Released released(open.may_wait());
    open.reads().raise(failure, to, from);
}

/// What `attempt` finds, as an object; throws what it is refused with.
template <class Attempt>
PyObject* transform_of(Open& open, PyObject* target, PyObject* source, Attempt&& attempt) {
    for (;;) {
        Failure failure;
        const Answer* const found = look_up(open, target, source, failure,
                                            [&](FrameHandle to, FrameHandle from, Answer& answer) {
                                                return attempt(to, from, answer, failure);
                                            });
        if (found == nullptr) {
            raise(open, failure, target, source);
        }
        if (PyObject* const names = open.paths().find(found->edges); names != nullptr) [[likely]] {
            return new_transform(*found, target, source, names);
        }
        // Making names may run Python code, and that another lookup.
        open.keep();
        const Answer own = *found;
        const nb::object names = open.paths().make(open.reads(), own.edges);
        if (names.is_valid()) {
            return new_transform(own, target, source, names.ptr());
        }
    }
}

constexpr std::array kLookupNames = {"target", "source", "time", "policy"};
constexpr std::array kLatestNames = {"target", "source", "max_age", "now"};

PyObject* lookup_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                           PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"lookup_transform", kLookupNames, 2, 4};
        const auto [target, source, time, policy] = bind<4>(kList, args, count, keywords);
        const std::optional<StampNs> stamp = optional_stamp_of(time);
        const Policy how = policy_of(policy);
        Open open(self);
        return transform_of(
            open, target, source,
            [&](FrameHandle to, FrameHandle from, Answer& answer, Failure& failure) {
                return open.reads().try_lookup(to, from, stamp, how, answer, failure);
            });
    });
}

PyObject* can_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                        PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"can_transform", kLookupNames, 2, 4};
        const auto [target, source, time, policy] = bind<4>(kList, args, count, keywords);
        const std::optional<StampNs> stamp = optional_stamp_of(time);
        const Policy how = policy_of(policy);
        const Open open(self);
        Failure failure;
        const bool can =
            look_up(open, target, source, failure,
                    [&](FrameHandle to, FrameHandle from, Answer& answer) {
                        return open.reads().try_lookup(to, from, stamp, how, answer, failure);
                    }) != nullptr;
        if (!can && failure.code == ErrorCode::kSnapshotTooOld) {
            raise(open, failure, target, source);
        }
        return PyBool_FromLong(can ? 1 : 0);
    });
}

PyObject* lookup_latest_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                                  PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"lookup_latest_transform", kLatestNames, 2, 4};
        const auto [target, source, age, when] = bind<4>(kList, args, count, keywords);
        std::optional<StampNs> max_age;
        StampNs now = 0;
        if (is_given(age)) {
            max_age = duration_of(age, "max_age");
            now = is_given(when) ? stamp_of(when) : now_of(made_reads(self).buffer);
        }
        Open open(self);
        return transform_of(
            open, target, source,
            [&](FrameHandle to, FrameHandle from, Answer& answer, Failure& failure) {
                return open.reads().try_lookup_latest(to, from, max_age, now, answer, failure);
            });
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

StampNs now_of(PyObject* buffer) {
    // A reference of its own: the call may drop the buffer's.
    const nb::object clock = nb::inst_ptr<BufferObject>(buffer)->clock;
    if (clock.is_valid()) {
        return stamp_of(nb::object(clock()).ptr());
    }
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

void add_raw_reads(nb::handle type) {
    for (PyMethodDef& method : g_methods) {
        const nb::object descriptor =
            nb::steal(PyDescr_NewMethod(reinterpret_cast<PyTypeObject*>(type.ptr()), &method));
        nb::setattr(type, method.ml_name, descriptor);
    }
}

}  // namespace tfdb::python
