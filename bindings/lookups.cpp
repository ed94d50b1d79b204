// The most frequent reads as raw methods: lookup_transform, lookup_latest_transform, can_transform.
#include "lookups.hpp"

#include <array>
#include <chrono>

#include "arguments.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "stamp.hpp"
#include "tfdb/store/clock.hpp"
#include "transform.hpp"

namespace tfdb::python {
namespace {

// One per thread that may be inside a lookup; no Python code runs while it is in use.
#ifdef Py_GIL_DISABLED
thread_local
#endif
    Answer g_answer;
// For lookups without the GIL: thread-local data are slower to reach.
thread_local Answer g_own_answer;

/// `self` of a raw method, readable until the end of the call. Construct it after the last Python
/// code, or call `keep` before: otherwise a snapshot that the GIL protects could be closed
/// meanwhile.
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

    /// Keeps a snapshot readable even while Python code runs.
    void keep() {
        // Another thread may have closed it before it was kept.
        if (keep_ == nullptr) {
            keep_ = object_.held;
        }
    }

    [[nodiscard]] const StoreReader& reads() const { return *reads_; }
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

    const StoreReaderObject& object_;
    const StoreReader* reads_;
    bool may_wait_;
    std::shared_ptr<Snapshot> keep_;
};

/// Looks up two frames by the cached handles of their names; if a frame is gone, by the names in
/// one state. Null: no answer. The question then contains the names.
const Answer* ask(const Open& open, PyObject* target, PyObject* source, Question& question,
                  Failure& failure) {
    NameCache& names = open.names();
    const bool may_wait = open.may_wait();
    Answer& answer = may_wait ? g_own_answer : g_answer;
    const auto attempt = [&] {
        const Released released(may_wait);
        return open.reads().ask(question, answer, failure);
    };
    question.target = names.find(target, "target");
    question.source = names.find(source, "source");
    bool found = attempt();
    if (!found) [[unlikely]] {
        const bool by_handle =
            question.target.name.data() == nullptr || question.source.name.data() == nullptr;
        question.target.name = name_of(target, "target");
        question.source.name = name_of(source, "source");
        if (by_handle && failure.code == ErrorCode::kUnknownFrame) {
            found = attempt();
        }
    }
    names.remember(target, question.target.handle);
    names.remember(source, question.source.handle);
    return found ? &answer : nullptr;
}

[[noreturn]] void raise(const Open& open, const Failure& failure, const Question& question) {
    const Released released(open.may_wait());
    open.reads().raise(failure, question);
}

/// The answer as an object; null without an answer. The question then contains the names.
PyObject* find_transform(Open& open, PyObject* target, PyObject* source, Question& question,
                         Failure& failure) {
    for (;;) {
        const Answer* const found = ask(open, target, source, question, failure);
        if (found == nullptr) {
            return nullptr;
        }
        if (PyObject* const names = open.paths().find(found->edges); names != nullptr) [[likely]] {
            return new_transform(*found, target, source, names);
        }
        // Creating names may run Python code, and that code may run another lookup.
        open.keep();
        const Answer own = *found;
        const nb::object names = open.paths().make(open.reads(), own.edges);
        if (names.is_valid()) {
            return new_transform(own, target, source, names.ptr());
        }
    }
}

/// The same; throws if the question is refused.
PyObject* transform_of(Open& open, PyObject* target, PyObject* source, Question& question) {
    Failure failure;
    PyObject* const made = find_transform(open, target, source, question, failure);
    if (made == nullptr) {
        raise(open, failure, question);
    }
    return made;
}

/// Throws the error of the failed question, which includes the time waited.
[[noreturn]] void raise_late(const Open& open, const Failure& failure, const Question& question,
                             StampNs waited, bool stopped) {
    try {
        raise(open, failure, question);
    } catch (const Error& error) {
        throw_object(nb::module_::import_("tfdb.store.waiting")
                         .attr("late")(error_object(error), waited, stopped));
        throw;
    }
}

/// The same, once there is an answer; throws after the timeout (none: never).
PyObject* await_transform(PyObject* self, PyObject* target, PyObject* source, Question& question,
                          std::optional<StampNs> longest) {
    if (!nb::isinstance<BufferObject>(self)) {
        throw InvalidArgument("a snapshot never changes: wait on the buffer");
    }
    BufferObject& buffer = *nb::inst_ptr<BufferObject>(self);
    using Clock = std::chrono::steady_clock;
    const Clock::time_point began = Clock::now();
    bool stopped = false;
    for (;;) {
        const StampNs waited = std::chrono::nanoseconds(Clock::now() - began).count();
        std::optional<StampNs> left = longest;
        if (left) {
            *left -= waited;
        }
        const bool late = left && *left <= 0;
        {
            Open open(self);
            Failure failure;
            PyObject* const made = find_transform(open, target, source, question, failure);
            if (made != nullptr) {
                return made;
            }
            if (longest == 0) {
                raise(open, failure, question);
            }
            if (late || stopped) {
                raise_late(open, failure, question, waited, !late);
            }
        }
        const Waiting work;
        stopped = !buffer.open_store().wait_for(question, left);
    }
}

Question question_at(PyObject* stamp, PyObject* policy) {
    Question question;
    question.stamp = optional_stamp_of(stamp);
    question.policy = policy_of(policy);
    return question;
}

constexpr std::array<std::string_view, 5> kLookupNames = {"target", "source", "stamp", "policy",
                                                          "timeout"};
constexpr std::array<std::string_view, 5> kWaitNames = {"target", "source", "stamp", "timeout",
                                                        "policy"};
constexpr std::array<std::string_view, 4> kCanNames = {"target", "source", "stamp", "policy"};
constexpr std::array<std::string_view, 4> kLatestNames = {"target", "source", "max_age", "now"};

PyObject* lookup_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                           PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"lookup_transform", kLookupNames, 2, 4};
        const auto [target, source, stamp, policy, timeout] = bind<5>(kList, args, count, keywords);
        Question question = question_at(stamp, policy);
        if (is_given(timeout)) [[unlikely]] {
            const StampNs longest = duration_of(timeout, "timeout");
            return await_transform(self, target, source, question, longest);
        }
        Open open(self);
        return transform_of(open, target, source, question);
    });
}

PyObject* lookup_edge(PyObject* self, PyObject* const* args, Py_ssize_t count, PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"_lookup_edge", kCanNames, 4, 4};
        const auto [parent, child, stamp, policy] = bind<4>(kList, args, count, keywords);
        Question question = question_at(stamp, policy);
        question.kind = Question::kEdge;
        Open open(self);
        return transform_of(open, parent, child, question);
    });
}

PyObject* wait_for_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                             PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"wait_for_transform", kWaitNames, 2, 4};
        const auto [target, source, stamp, timeout, policy] = bind<5>(kList, args, count, keywords);
        Question question = question_at(stamp, policy);
        std::optional<StampNs> longest;
        if (is_given(timeout)) {
            longest = duration_of(timeout, "timeout");
        }
        return await_transform(self, target, source, question, longest);
    });
}

PyObject* can_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                        PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"can_transform", kCanNames, 2, 4};
        const auto [target, source, stamp, policy] = bind<4>(kList, args, count, keywords);
        Question question = question_at(stamp, policy);
        question.kind = Question::kCan;
        const Open open(self);
        Failure failure;
        const bool can = ask(open, target, source, question, failure) != nullptr;
        if (!can && failure.code == ErrorCode::kSnapshotTooOld) {
            raise(open, failure, question);
        }
        return PyBool_FromLong(can ? 1 : 0);
    });
}

PyObject* lookup_latest_transform(PyObject* self, PyObject* const* args, Py_ssize_t count,
                                  PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"lookup_latest_transform", kLatestNames, 2, 4};
        const auto [target, source, age, when] = bind<4>(kList, args, count, keywords);
        Question question{.kind = Question::kLatest};
        if (is_given(age)) {
            question.max_age = duration_of(age, "max_age");
            question.now = is_given(when) ? stamp_of(when) : now_of(made_reads(self).buffer);
        }
        Open open(self);
        return transform_of(open, target, source, question);
    });
}

PyMethodDef g_wait_method = {
    "wait_for_transform", as_function(wait_for_transform), METH_FASTCALL | METH_KEYWORDS,
    "wait_for_transform($self, target, source, stamp=None, timeout=None, *, policy=None)\n--\n\n"
    "Wait until `lookup_transform` succeeds, and return its result.\n\n"
    "A commit of any thread or process that touches the path, or creates a missing frame, wakes\n"
    "it. Other threads and signal handlers run meanwhile.\n\n"
    "Parameters\n----------\n"
    "target, source, stamp, policy\n    As in `lookup_transform`.\n"
    "timeout\n    Longest wait in seconds; None: no limit.\n\n"
    "Returns\n-------\nTransform\n\n"
    "Raises\n------\n"
    "At the end of the timeout the error of `lookup_transform`, with the length of the wait;\n"
    "InvalidName at once for an invalid name; BufferClosed (`close` was called meanwhile),\n"
    "NoSuchStore (the shared store was removed), TransactionActive, NotSupported (a\n"
    "research engine; or this process may not write to the control file of the\n"
    "store), InvalidArgument"};

PyMethodDef g_methods[] = {
    {"lookup_transform", as_function(lookup_transform), METH_FASTCALL | METH_KEYWORDS,
     "lookup_transform($self, target, source, stamp=None, policy=None, *, timeout=None)\n--\n\n"
     "T[target<-source] at a stamp: maps points of `source` into `target`.\n\n"
     "Parameters\n----------\n"
     "target, source\n    Frame names.\n"
     "stamp\n    Stamp in nanoseconds (or an object that holds one). None: the latest common\n"
     "    time, at which every moving edge of the path has data.\n"
     "policy\n    How a pose between samples is computed. None: Interpolate().\n"
     "timeout\n    Longest wait for the data, in seconds; None: no wait. Only a Buffer takes\n"
     "    it. At its end the error of a lookup without timeout is raised; see\n"
     "    `wait_for_transform`.\n\n"
     "Returns\n-------\nTransform\n    With a report of the samples that were used.\n\n"
     "Raises\n------\n"
     "UnknownFrame, Disconnected, Extrapolation, GapTooLarge, Stale, NoSampleNear, InvalidStamp,\n"
     "InvalidTransform (the numbers on the path are so large that the result is not finite),\n"
     "SnapshotTooOld, SnapshotClosed"},
    {"lookup_latest_transform", as_function(lookup_latest_transform), METH_FASTCALL | METH_KEYWORDS,
     "lookup_latest_transform($self, target, source, max_age=None, now=None)\n--\n\n"
     "T[target<-source] from each edge's own newest sample; nothing is interpolated.\n\n"
     "Parameters\n----------\n"
     "target, source\n    Frame names.\n"
     "max_age\n    Seconds. An edge whose newest sample is older than `now - max_age` is refused.\n"
     "now\n    Stamp in nanoseconds; None asks the buffer's clock.\n\n"
     "Returns\n-------\nTransform\n    Its stamp is the oldest of the stamps used, 0 if nothing\n"
     "    moves.\n\n"
     "Raises\n------\nUnknownFrame, Disconnected, Extrapolation (an edge has no data), Stale,\n"
     "InvalidStamp, InvalidArgument, SnapshotTooOld, SnapshotClosed"},
    {"_lookup_edge", as_function(lookup_edge), METH_FASTCALL | METH_KEYWORDS,
     "_lookup_edge($self, target, source, stamp, policy)\n--\n\n"
     "`lookup_transform` over the edge from `source` to its parent `target`: no other edge is\n"
     "read.\n\n"
     "Raises Disconnected if the edge has another parent at the stamp, and what\n"
     "`lookup_transform` raises."},
    {"can_transform", as_function(can_transform), METH_FASTCALL | METH_KEYWORDS,
     "can_transform($self, target, source, stamp=None, policy=None)\n--\n\n"
     "Return whether `lookup_transform` with these arguments returns a transform.\n\n"
     "Raises\n------\nInvalidStamp, SnapshotTooOld, SnapshotClosed"},
};

}  // namespace

bool can_find_pose(PyObject* buffer, PyObject* target, PyObject* source,
                   std::optional<StampNs> stamp) {
    Question question{.kind = Question::kCan};
    question.stamp = stamp;
    const Open open(buffer);
    Failure failure;
    return ask(open, target, source, question, failure) != nullptr;
}

std::optional<Found> find_pose(PyObject* buffer, PyObject* target, PyObject* source,
                               std::optional<StampNs> stamp) {
    Question question;
    question.stamp = stamp;
    const Open open(buffer);
    Failure failure;
    if (const Answer* const answer = ask(open, target, source, question, failure)) [[likely]] {
        return Found{answer->pose, answer->stamp};
    }
    return std::nullopt;
}

void add_raw_waits(nb::handle type) {
    add_raw_method(type, g_wait_method);
}

StampNs now_of(PyObject* buffer) {
    // An own reference: the call may drop the buffer's.
    const nb::object clock = nb::inst_ptr<BufferObject>(buffer)->clock;
    if (clock.is_valid()) {
        return stamp_of(nb::object(clock()).ptr());
    }
    return nb::inst_ptr<BufferObject>(buffer)->store.clock().now();
}

void add_raw_reads(nb::handle type) {
    for (PyMethodDef& method : g_methods) {
        add_raw_method(type, method);
    }
    add_raw_batch(type);
}

}  // namespace tfdb::python
