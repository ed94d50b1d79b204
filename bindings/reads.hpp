// The Python objects Buffer and Snapshot, and their common reads.
#pragma once

#include <nanobind/nanobind.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "names.hpp"
#include "paths.hpp"
#include "tfdb/base/interruption.hpp"
#include "tfdb/store/buffer.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// Conditions for a call on a store, in one word. The first part counts reasons to wait: the call
/// may wait for a thread that needs the GIL, because its engine holds locks across Python code or
/// an open transaction runs alone. Without such reasons quick calls keep the GIL. The second part
/// counts open transactions, one of which may be the calling thread's.
/// Threads: any. Guarantee: wait-free.
class Reasons {
public:
    void add_wait() { ++word_; }
    void end_wait() { --word_; }
    void add_transaction() { word_ += kTransaction; }
    void end_transaction() { word_ -= kTransaction; }
    [[nodiscard]] bool to_wait() const { return word_ % kTransaction != 0; }
    [[nodiscard]] bool none() const { return word_ == 0; }
    [[nodiscard]] bool transactions() const { return word_ >= kTransaction; }

private:
    static constexpr std::uint64_t kTransaction = std::uint64_t{1} << 32U;
    std::atomic<std::uint64_t> word_{0};
};

/// The object behind the Python class StoreReader. Threads: the holder of the GIL; without a GIL,
/// any.
/// Guarantee: `reads` is null once it is closed, and nothing is read after that.
struct StoreReaderObject {
    const StoreReader* reads = nullptr;
    const Reasons* waits = nullptr;  // of the buffer
    NameCache* names = nullptr;      // of the buffer
    PathNames* paths = nullptr;      // of the buffer
    // the Buffer object, borrowed: itself, or the one that a snapshot holds
    PyObject* buffer = nullptr;
    CommitNumber closed_commit = 0;
    std::shared_ptr<Snapshot> held;  // of a snapshot
};

[[noreturn]] void throw_closed(const StoreReaderObject& object);

/// The refused edges that a warning has named, once per error. It forgets all of them if they
/// become too many, as with names from damaged messages.
/// Threads: one at a time. Guarantee: bounded memory.
class WarnedEdges {
public:
    [[nodiscard]] bool is_new(ErrorCode code, std::string edge) {
        constexpr std::size_t kMost = 4096;
        if (edges_.size() >= kMost)
            edges_.clear();
        return edges_.emplace(code, std::move(edge)).second;
    }

private:
    std::set<std::pair<ErrorCode, std::string>> edges_;
};

struct BufferObject : StoreReaderObject {
    explicit BufferObject(Buffer opened) : store(std::move(opened)) { point_at_own(); }
    explicit BufferObject(const BufferOptions& options) : store(options) {
        point_at_own();
        if (options.concurrency != Concurrency::kSnapshot) {
            reasons.add_wait();
        }
    }

    /// For calls that change it, or wait. Throws BufferClosed.
    [[nodiscard]] Buffer& open_store() {
        if (closed.load(std::memory_order_relaxed)) [[unlikely]] {
            throw_closed(*this);
        }
        return store;
    }

    Buffer store;
    std::atomic<bool> closed{false};
    std::atomic<bool> waits_begun{false};  // see `_set_waits_begun`
    Reasons reasons;
    NameCache own_names;
    PathNames own_paths;
    nb::object clock;  // none: the system's
    WarnedEdges warned;

private:
    void point_at_own() {
        reads = &store;
        names = &own_names;
        paths = &own_paths;
        waits = &reasons;
    }
};

struct SnapshotObject : StoreReaderObject {
    nb::object owner;  // keeps `buffer` alive
};

/// The Python object of a snapshot; `buffer` is the Buffer object.
nb::object snapshot_object(nb::handle buffer, Snapshot&& taken);

/// For a lookup through a fixed frame; None as a stamp is the latest common time.
Question question_through(nb::handle fixed, nb::handle target, nb::handle target_stamp,
                          nb::handle source, nb::handle source_stamp, nb::handle policy);

/// Releases the GIL during its lifetime, if requested.
class Released {
public:
    explicit Released(bool release) {
        if (release) {
            released_.emplace();
        }
    }

private:
    std::optional<nb::gil_scoped_release> released_;
};

/// Long work, without the GIL if requested, that a signal may end. In the main thread Python's
/// signal handlers run every few milliseconds; their errors (KeyboardInterrupt) are thrown.
// NOLINTNEXTLINE(cppcoreguidelines-virtual-class-destructor): final, and on the stack only
class LongWork final : public Interruption {
public:
    /// `between`: calls of `ask` within this time after the last one do nothing.
    explicit LongWork(bool release, std::chrono::milliseconds between = kBetween);
    ~LongWork();
    LongWork(const LongWork&) = delete;
    LongWork& operator=(const LongWork&) = delete;

    void ask() override;

private:
    using Clock = std::chrono::steady_clock;
    static constexpr std::chrono::milliseconds kBetween{5};

    Interruption* before_;
    PyThreadState* state_ = nullptr;  // of the released GIL
    bool release_;
    std::chrono::milliseconds between_;
    Clock::time_point next_;
};

/// Makes later calls of Python from this thread cheaper, if another library started it. Such a
/// thread has a new state for each call, with a stack that is mapped and unmapped. From now on the
/// state stays until the thread ends.
void keep_thread_state();

/// A wait, without the GIL, that a signal ends at once.
/// Threads: as LongWork. Guarantee: none.
class Waiting {
public:
    Waiting() : work_(true, std::chrono::milliseconds(0)) {}

private:
    LongWork work_;
};

/// The reads of an open object. The pointer keeps a snapshot readable for calls without the GIL,
/// even if another thread closes it.
struct Pinned {
    std::shared_ptr<Snapshot> keep;
    const StoreReader& reads;
    const Reasons& waits;

    /// Whether the next call must not keep the GIL.
    [[nodiscard]] bool may_wait() const { return waits.to_wait(); }
    /// Returns the result of `question(reads)`; releases the GIL if it may have to wait.
    template <class Question>
    auto ask(Question&& question) const {
        const LongWork work(may_wait());
        return question(reads);
    }
    /// The same for calls that take long on a large store: always without the GIL.
    template <class Question>
    auto ask_long(Question&& question) const {
        const LongWork work(true);
        return question(reads);
    }
};
/// Throws SnapshotClosed; TransactionActive if a thread reads a buffer during its transaction.
Pinned pin(nb::handle self, const StoreReaderObject& object);

/// Throws TransactionActive if the object is a buffer and this thread has an open transaction of
/// it.
void check_not_in_transaction(const StoreReaderObject& object);

/// Throws TypeError: `self` is not an `expected`, or, if that is null, its __init__ never ran.
[[noreturn]] void throw_not_made(nb::handle self, const char* expected);

/// The class of `tfdb` for these objects: the Python subclass if there is one.
template <class Object>
inline nb::handle g_offered;  // null: none was adopted

template <class Object>
nb::handle offered_type() {
    return g_offered<Object>.is_valid() ? g_offered<Object> : nb::type<Object>();
}

/// An object of that class.
template <class Object, class... Args>
nb::object make_offered(Args&&... args) {
    nb::object made = nb::inst_alloc(offered_type<Object>());
    new (nb::inst_ptr<Object>(made)) Object{std::forward<Args>(args)...};
    nb::inst_mark_ready(made);
    return made;
}

/// The object behind `self`. Throws TypeError if it is of another class or its __init__ never ran.
template <class Object>
Object& object_of(nb::handle self) {
    if (!nb::isinstance<Object>(self)) {
        throw_not_made(self, nb::type_name(offered_type<Object>()).c_str());
    }
    if (!nb::inst_ready(self)) {
        throw_not_made(self, nullptr);
    }
    return *nb::inst_ptr<Object>(self);
}

/// The same for callers that know the class, such as methods whose `self` Python has checked.
inline StoreReaderObject& made_reads(PyObject* self) {
    if (!nb::inst_ready(self)) {
        throw_not_made(self, nullptr);
    }
    return *nb::inst_ptr<StoreReaderObject>(self);
}

void bind_signals();
void bind_reads(nb::module_& module);
/// The methods that bypass nanobind: of StoreReader, of Buffer, of Transaction. The classes of
/// `tfdb` get them directly, which makes calls faster.
void add_raw_reads(nb::handle type);
void add_raw_batch(nb::handle type);
void add_raw_waits(nb::handle type);
void add_raw_writes(nb::handle type);
void add_raw_transaction_writes(nb::handle type);
void bind_batch(nb::class_<StoreReaderObject>& type);
void bind_records(nb::class_<StoreReaderObject>& type);
void bind_buffer(nb::module_& module);
void bind_changes(nb::class_<BufferObject, StoreReaderObject>& type);
void bind_commits(nb::class_<BufferObject, StoreReaderObject>& type);
void bind_applier(nb::module_& module, nb::class_<BufferObject, StoreReaderObject>& type);
void bind_state_bytes(nb::class_<SnapshotObject, StoreReaderObject>& type);
void bind_clock(nb::module_& module, nb::class_<BufferObject, StoreReaderObject>& type);
void bind_watch(nb::module_& module, nb::class_<BufferObject, StoreReaderObject>& type);
void bind_waits(nb::class_<BufferObject, StoreReaderObject>& type);
/// `adopt_classes`, and functions for Python modules.
void bind_helpers(nb::module_& module);
/// Functions for streams.
void bind_sample_rows(nb::module_& module);
void bind_policy(nb::module_& module);
void bind_adaptive(nb::module_& module);
void bind_wire(nb::module_& module, nb::class_<BufferObject, StoreReaderObject>& type);
void bind_transaction(nb::module_& module, nb::class_<BufferObject, StoreReaderObject>& type);

/// None stands for the default.
Policy policy_of(PyObject* object);

/// The time of the buffer's clock.
StampNs now_of(PyObject* buffer);

}  // namespace tfdb::python
