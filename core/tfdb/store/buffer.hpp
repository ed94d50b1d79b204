// The store: frames and their transforms, written in atomic commits and read from snapshots.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/base/types.hpp"
#include "tfdb/clock/stamp.hpp"
#include "tfdb/geometry/pose.hpp"
#include "tfdb/lookup/answer.hpp"
#include "tfdb/lookup/policy.hpp"
#include "tfdb/store/question.hpp"
#include "tfdb/store/wait_end.hpp"
#include "tfdb/wire/commit_sample.hpp"
#include "tfdb/wire/tf_message.hpp"

namespace tfdb {

using geometry::Pose;
using lookup::EdgeUse;
using wire::Epoch;
using wire::TransformView;

/// The isolation of concurrent lookups, writes and transactions: see store/engine.hpp.
enum class Concurrency : std::uint8_t {
    kSnapshot,   // the default: reads from snapshots, one commit at a time
    kGiant,      // one mutex for everything, as in tf2
    kFine,       // a lock per frame, held while that frame is read or written: not atomic
    kNoWait,     // two-phase locking; a refused write lock restarts the transaction
    kWaitDie,    // two-phase locking; the older waits for the younger, the younger restarts
    kWoundWait,  // two-phase locking; the older makes the younger restart
    kSilo,       // optimistic: reads are validated at the end
};
inline constexpr std::size_t kConcurrencies = 7;

/// "snapshot", "giant", "fine", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo".
[[nodiscard]] std::string_view concurrency_name(Concurrency concurrency);
/// Throws InvalidArgument, which names the valid ones.
[[nodiscard]] Concurrency concurrency_of(std::string_view name);

/// The error of a transform that every store refuses: InvalidTransform, InvalidStamp, InvalidName.
/// None if some store may accept it.
[[nodiscard]] std::optional<Error> fault_of(const TransformView& transform, std::size_t index,
                                            bool is_static, std::string_view authority);

struct BufferOptions {
    std::optional<StampNs> history_ns = 10 * clock::kNanosPerSecond;  // none: unlimited
    std::uint32_t max_frames = kMaxFrames;
    std::optional<std::size_t> memory_limit;             // bytes; none: the machine's memory
    std::size_t snapshot_memory = std::size_t{1} << 30;  // maximum growth for held snapshots
    Concurrency concurrency = Concurrency::kSnapshot;
};

/// Options of a new shared store.
struct ShareOptions {
    // maximum size in bytes; pages are allocated as it grows
    std::size_t size = std::size_t{1} << 30;
    unsigned mode = 0600;     // permissions of its files
    std::int64_t group = -1;  // of its files; -1: that of the process
};

/// Properties of a shared store.
struct SharedUse {
    std::string path;
    bool writable = false;
    std::int64_t lock_timeout_ns = 0;
    std::size_t size = 0;         // maximum size in bytes
    std::uint64_t repairs = 0;    // commits rolled back after their writer's death
    std::uint64_t processes = 0;  // processes that have it open, including this one; 0: unknown
};

/// Properties of a frozen store.
struct FrozenUse {
    std::string path;
    std::size_t size = 0;  // bytes of its file
    std::string origin;    // the text given to `freeze`
};

namespace store {

struct Store;  // what a Buffer and its Snapshots share: store.hpp
class Applying;

/// Replaces a snapshot's commit: each read uses the newest state.
inline constexpr CommitNumber kNewest = ~CommitNumber{0};

/// The fault of an invalid frame name ("is empty"); null for a valid one.
[[nodiscard]] const char* name_fault(std::string_view name) noexcept;
inline constexpr const char* kNameRule =
    ": a name has 1 to 1024 bytes of UTF-8 and no control characters";

}  // namespace store

/// One frame in one snapshot.
struct FrameInfo {
    std::string name;
    std::optional<std::string> parent;  // none for a root
    bool is_static = false;
    std::uint64_t samples = 0;  // visible moving samples, or 1 for a static edge
    StampNs oldest = -1;        // -1: no moving samples
    StampNs newest = -1;
    StampNs longest_gap = 0;
    bool cleared = false;    // a clear removed its samples, and none came since
    std::string authority;   // the last writer, in the newest state
    std::uint64_t late = 0;  // out-of-order samples, in the newest state
};

/// Summaries of all frames of one state, sorted by name. Rows refer to frames by index.
struct TreeColumns {
    static constexpr std::uint32_t kNone = ~std::uint32_t{0};
    /// As in FrameInfo.
    struct Row {
        std::uint32_t parent = kNone;  // index in `names`; kNone for a root
        std::uint32_t authority = 0;   // index in `authorities`
        bool is_static = false;
        bool cleared = false;
        std::uint64_t samples = 0;
        StampNs oldest = -1;
        StampNs newest = -1;
        StampNs longest_gap = 0;
        std::uint64_t late = 0;
    };
    std::vector<std::string> names;
    std::vector<std::string> authorities;  // without duplicates
    std::vector<Row> rows;                 // one per name
};

/// The ends of two walks along edges with data at a stamp: one from the source up to its root or to
/// the target, and one from the target up to the first walk's end.
struct Reach {
    enum End : std::uint8_t {
        kMet,      // they meet
        kApart,    // both end at roots
        kGap,      // one ends at an edge without data; if both do, the target's edge counts
        kNowhere,  // a frame does not exist
    };
    End end = kMet;
    StampNs stamp = 0;  // stamp of the walks
    std::string edge;   // kGap: its child
    StampNs oldest = -1;
    StampNs newest = -1;  // its data; -1: cleared
};

struct Samples {
    std::vector<StampNs> stamps;  // -1 for a static edge's one sample
    std::vector<Pose> poses;
    std::vector<std::string> parents;
};

struct MemoryUse {
    std::size_t used_bytes = 0;       // allocated to samples, names and tables
    std::size_t free_bytes = 0;       // kept for reuse
    std::size_t frames = 0;           // frame slots in use, 192 bytes each
    std::size_t samples = 0;          // stored samples, including those beyond the history
    std::size_t frame_bytes = 0;      // frames * header size
    std::size_t authority_bytes = 0;  // names of writers, not included in `used_bytes`
};

struct Counters {
    std::uint64_t commits = 0;
    std::uint64_t normalised = 0;    // quaternions normalised, off by more than 1e-9
    std::uint64_t lapped_reads = 0;  // single lookups that were repeated
    std::uint64_t pinned_reads = 0;  // ... and finally pinned their state
    std::uint64_t aborts = 0;      // transactions that ended without a commit, including conflicts
    std::uint64_t conflicts = 0;   // transactions aborted by a conflicting commit
    std::uint64_t retries = 0;     // lookups and writes that the engine repeated
    std::uint64_t lock_waits = 0;  // waits for a frame's lock
};

struct Twist {
    geometry::Vec3 linear;   // m/s
    geometry::Vec3 angular;  // rad/s
};

/// The effects of one commit. Frames have their names of that commit.
struct Changes {
    /// Samples T[parent<-child] of one edge, in stamp order.
    struct Edge {
        std::string child;
        std::string authority;  // the commit's writer of the edge
        bool is_static = false;
        std::vector<std::string> parents;  // one per sample
        std::vector<StampNs> stamps;       // -1 for a static pose
        std::vector<Pose> poses;
        std::uint64_t gone = 0;  // samples of the commit that are no longer stored
    };
    CommitNumber commit = 0;
    std::vector<Edge> stored;
    std::vector<std::string> made;     // new frames
    std::vector<std::string> moved;    // existing frames with a changed parent, or none
    std::vector<std::string> cleared;  // frames whose samples were dropped before `stored`
    std::vector<std::string> removed;
    std::vector<std::string> passing;  // created and removed; samples of others may name them
};

/// The maximum content of one sample of commits.
struct SampleLimits {
    std::size_t commits = 64;
    /// A commit is never split: a larger one gets its own sample.
    std::size_t bytes = std::size_t{1} << 20;
};

/// The position up to which a source's commits have been applied.
struct Position {
    std::string source;
    Epoch epoch;
    CommitNumber commit = 0;   // the last applied one
    std::uint64_t choice = 0;  // digests of the shared frames and of the chosen frames
    std::string prefix{};      // prefix of its frames' names

    [[nodiscard]] bool operator==(const Position&) const = default;
};

/// How another store's commits are applied.
struct ApplyOptions {
    std::string_view source{};                   // the source's name in this store
    std::string_view prefix{};                   // prefix of its frames' names
    std::span<const std::string_view> shared{};  // names without the prefix
};

/// How a source's position changes without its commits, because its home has changed.
enum class Handover : std::uint8_t {
    kFollow,   // the new home continues exactly at the position
    kRelease,  // this store is the home: its writers may write
    kAdopt,    // this store was the home: its writers' data become the source's, and read-only
};

struct HandedOver {
    CommitNumber commit = 0;  // number of this store's commit
    /// Whether this store's content was exactly the source's at its commit `last`.
    bool is_whole = false;
    CommitNumber last = 0;
};

/// Frames whose samples commits of a source have replaced.
struct LostParents {
    std::vector<std::string> local;     // samples of local writers
    std::vector<std::string> disputed;  // shared frames: samples of another source
};

/// Exceptions to the rules of a write.
struct WriteRules {
    /// A moving edge may become static and a static one moving: its samples are dropped in the same
    /// commit. Its frame and the frames below it stay.
    bool change_kind = false;
    /// A repeated stamp, of the edge or of an earlier member of the batch, is refused as
    /// RepeatedStamp: the first value stays. Not for static transforms, which have no stamp.
    bool only_new = false;

    [[nodiscard]] bool any() const { return change_kind || only_new; }
};

/// Moving samples T[parent<-child] of one edge as columns, one stamp per pose.
struct EdgeColumns {
    std::string_view parent;
    std::string_view child;
    std::span<const StampNs> stamps;
    std::span<const Pose> poses;
};

/// The members to store, and options.
struct WriteRequest {
    std::span<const TransformView> transforms{};
    /// Alternative to `transforms`; not static. Samples that ascend from the edge's newest one are
    /// stored without a copy. Other threads may change the columns: each row is validated as it is
    /// stored.
    const EdgeColumns* columns = nullptr;
    bool is_static = false;
    std::string_view authority{};
    WriteRules rules{};
    /// Stores the valid members and returns the others, instead of all or none. If members would
    /// close a cycle together, the last one is refused, with the other samples of its edge at that
    /// time. The rest is validated again.
    bool partial = false;
    // for another writer; otherwise nothing is stored while it holds the commit lock
    bool wait = true;

    [[nodiscard]] std::size_t size() const {
        return columns != nullptr ? columns->stamps.size() : transforms.size();
    }
};

/// The result of a write.
struct WriteResult {
    CommitNumber commit = 0;               // its number; the newest one if nothing was stored
    std::vector<RefusedMember> refused{};  // `partial`: in the order of the request
    bool busy = false;                     // nothing was stored, because it would have had to wait
};

/// How long the newest sample of an edge answers. Names may contain `*`, for any text.
struct Lifespan {
    std::string parent;
    std::string child;
    StampNs limit = 0;
    std::string expectation{};  // its name in errors

    friend bool operator==(const Lifespan&, const Lifespan&) = default;
};

enum class Layout : std::uint8_t { kPose, kMatrix };  // rows of 7, or of 16 (4x4 row-major)
enum class Missing : std::uint8_t { kThrow, kNan };

class Snapshot;
class Clock;
class Watch;
struct Watched;

/// The common reads of a Buffer (each from a fresh snapshot) and a Snapshot (from its own).
/// Threads: any number may call concurrently. Guarantee: in the default engine no read takes the
/// commit lock; `frame_info` and `tree` share a lock with writers that add an authority.
class StoreReader : public store::LookupsByName<StoreReader> {
public:
    /// Finds a frame by name. False if the snapshot lacks it. Throws SnapshotTooOld.
    [[nodiscard]] bool find_frame(std::string_view name, FrameHandle& out) const;
    /// True while the handle's slot has not been reused, even if its frame is gone.
    [[nodiscard]] bool is_current(FrameHandle handle) const noexcept;

    /// False: `failure` has the reason. It neither throws nor allocates; `raise` throws the typed
    /// error with names. Edges older than now - max_age fail as kStale. kCommonTime and kCovered
    /// answer in `answer.stamp`, the latest stamp, and `answer.oldest`.
    [[nodiscard]] bool ask(Question& question, Answer& answer, Failure& failure) const;
    using LookupsByName::ask;
    /// Throws the typed error of a failed question.
    [[noreturn]] void raise(const Failure& failure, const Question& question) const;

    /// The frame's parent at a stamp (none: in its newest sample). Outside the edge's data: the
    /// parent in the nearest sample, unless the frame would then be its own ancestor. None for a
    /// root. Throws UnknownFrame.
    [[nodiscard]] std::optional<std::string> parent_of(
        std::string_view name, std::optional<StampNs> stamp = std::nullopt) const;

    /// Rows of T[target<-source] at each stamp, in any order, all from one snapshot: bit for bit
    /// equal to single lookups. `out` holds 7 or 16 doubles per stamp and must not overlap the
    /// stamps (InvalidArgument). Missing::kThrow: throws the typed error of the first stamp without
    /// an answer, with its index; `out` is then unspecified. Missing::kNan: NaN for such a stamp,
    /// whatever the reason; only UnknownFrame is thrown.
    void lookup_many(std::string_view target, std::string_view source,
                     std::span<const StampNs> stamps, Policy policy, Layout layout, Missing missing,
                     std::span<double> out) const {
        FrameRef into{.name = target};
        FrameRef from{.name = source};
        lookup_many(into, from, stamps, policy, layout, missing, out);
    }
    /// The same for frames with names and optional handles; it sets the handles.
    void lookup_many(FrameRef& target, FrameRef& source, std::span<const StampNs> stamps,
                     Policy policy, Layout layout, Missing missing, std::span<double> out) const;
    /// Rows of T[parent<-frame] of each frame's edge at a stamp (none: its newest), all from one
    /// snapshot. They equal, bit for bit, single lookups of the frames and their parents; floats
    /// are rounded from those. `out` holds 7 numbers per frame (InvalidArgument). It sets the
    /// handles. `missing` as in lookup_many, and also for frames that do not exist or have no
    /// parent (Disconnected). `Real`: float or double.
    template <class Real>
    void lookup_edges(std::span<FrameRef> frames, std::optional<StampNs> stamp, Policy policy,
                      Missing missing, std::span<Real> out) const;
    /// p_target = T[target<-source](stamp of the point) p_source; strides in elements. One stamp
    /// per point, or a single one for all. It works in place (out == points). Any other overlap of
    /// `out` with the points or the stamps is refused (InvalidArgument). `Real`: float or double.
    template <class Real>
    void transform_points(std::string_view target, std::string_view source, const Real* points,
                          std::size_t stride, std::size_t count, std::span<const StampNs> stamps,
                          Policy policy, Missing missing, Real* out, std::size_t out_stride) const;
    /// The stored stamps of the moving edges between two frames, sorted, without duplicates, within
    /// [start, end] and within the range that every edge covers.
    [[nodiscard]] std::vector<StampNs> path_stamps(std::string_view target, std::string_view source,
                                                   std::optional<StampNs> start,
                                                   std::optional<StampNs> end) const;
    /// Velocity of `source` in `target`, by finite difference over `interval` ns around `stamp`
    /// (none: latest common time). It is the velocity of the point `point`, given in `point_frame`,
    /// in the axes of `reference`. Empty names: reference = target, point_frame = source.
    [[nodiscard]] Twist lookup_velocity(std::string_view target, std::string_view source,
                                        std::optional<StampNs> stamp, StampNs interval,
                                        std::string_view reference, geometry::Vec3 point,
                                        std::string_view point_frame) const;

    [[nodiscard]] std::vector<std::string> frames() const;  // sorted
    [[nodiscard]] FrameInfo frame_info(std::string_view name) const;
    /// All frames with their parents at `stamp` (none: newest), sorted by name.
    [[nodiscard]] std::vector<FrameInfo> tree(std::optional<StampNs> stamp = std::nullopt) const;
    [[nodiscard]] TreeColumns tree_columns(std::optional<StampNs> stamp = std::nullopt) const;
    [[nodiscard]] Samples samples(std::string_view name) const;
    /// At a stamp, which may be negative; none: the latest common time. At stamp 0 of a static
    /// path, moving edges have their newest parents.
    [[nodiscard]] Reach reach(std::string_view target, std::string_view source,
                              std::optional<StampNs> stamp) const;
    /// Name of a frame in an answer; "(removed)" if its slot was reused since.
    [[nodiscard]] std::string frame_name(FrameId id, std::uint32_t generation) const;
    [[nodiscard]] CommitNumber commit() const;  // of the state that is read

protected:
    StoreReader(std::shared_ptr<store::Store> store, CommitNumber held)
        : store_(std::move(store)), held_(held) {}

    std::shared_ptr<store::Store> store_;
    CommitNumber held_;  // the snapshot's commit, or kNewest

private:
    template <class Emit>
    void run_batch(FrameRef& target, FrameRef& source, std::span<const StampNs> stamps,
                   Policy policy, bool stop, Emit emit) const;
};

/// One committed state, kept readable. Threads: any. Guarantee: every read through it sees exactly
/// that commit. A read throws SnapshotTooOld once writers had to overwrite the state
/// (snapshot_memory was too small).
class Snapshot : public StoreReader {
public:
    ~Snapshot();
    Snapshot(Snapshot&&) noexcept;
    Snapshot& operator=(Snapshot&&) = delete;
    Snapshot(const Snapshot&) = delete;
    Snapshot& operator=(const Snapshot&) = delete;

    /// The state of a later commit, or of the same one. This snapshot protects all of them while it
    /// is held. The result shares its pin, and the two may be destroyed in any order. If writers
    /// had to overwrite the state, its reads throw SnapshotTooOld, as for any snapshot. Throws
    /// InvalidArgument for an older or future commit. In research engines it excludes all other
    /// operations, and throws TransactionActive.
    [[nodiscard]] Snapshot at(CommitNumber commit) const;

    /// Writes this state into a file for `Buffer::open_frozen`: its reads return what reads of this
    /// snapshot return. The complete file replaces a file of that name; processes that have the old
    /// one open keep it. `origin`: any text, which is stored. `in_place`: the file is written under
    /// `path`, which must not exist, from the start; the caller renames it later. Throws
    /// SnapshotTooOld, CapacityExceeded (the disk is full, or 65,535 authorities), NoSuchStore (no
    /// such folder), StoreExists (`in_place`), ReadOnly (no permission).
    void freeze(const std::string& path, std::string_view origin = {}, bool in_place = false) const;

    /// The whole state, or these frames with the newest samples of each edge, as a sample for
    /// `Buffer::apply`. `as`: in a copy, the source's position: the state is then encoded as the
    /// source's, and the source's later commits can follow. Throws SnapshotTooOld.
    [[nodiscard]] std::vector<std::byte> state_bytes(
        std::optional<std::span<const std::string_view>> only = std::nullopt,
        std::size_t newest = ~std::size_t{0}, const Position* as = nullptr) const;

private:
    friend class Buffer;
    Snapshot(std::shared_ptr<store::Store> store, CommitNumber held, unsigned pin,
             std::uint64_t forks);
    [[nodiscard]] bool is_counted() const;

    unsigned pin_;         // its count of held snapshots
    std::uint64_t forks_;  // of its process: in a shared store a child's copy is not counted
};

/// The store. Threads: any number may read and write concurrently; writers are serialised.
/// Guarantee: a commit is all or nothing, even if it throws.
class Buffer : public StoreReader {
public:
    /// Throws InvalidArgument (history <= 0, max_frames 0 or > kMaxFrames), CapacityExceeded.
    explicit Buffer(const BufferOptions& options = {});

    /// Creates a shared store: a file in a memory file system, such as /dev/shm, and a control file
    /// beside it. Other processes see it complete or not at all. Throws InvalidArgument (also: a
    /// size too small for its frames), StoreExists, NoSuchStore (missing folder), ReadOnly,
    /// CapacityExceeded.
    static void create(const std::string& path, const ShareOptions& share = {},
                       const BufferOptions& options = {});
    /// Opens it. `lock_timeout_ns`: how long writes wait for another process's write before they
    /// throw LockTimeout. Throws NoSuchStore, CorruptStore, ReadOnly, CapacityExceeded.
    [[nodiscard]] static Buffer open(const std::string& path, bool writable,
                                     std::int64_t lock_timeout_ns = 10 * clock::kNanosPerSecond);
    /// Removes it; processes that have it open keep it. Throws NoSuchStore, CorruptStore, ReadOnly.
    static void unlink(const std::string& path);
    /// None for private and frozen stores.
    [[nodiscard]] std::optional<SharedUse> shared() const;

    /// Opens a frozen store, which is read-only. `verify`: checks the checksum of the whole file,
    /// otherwise only of its header. Throws NoSuchStore, CorruptStore (also: damaged, other version
    /// or machine), ReadOnly (no read permission), CapacityExceeded.
    [[nodiscard]] static Buffer open_frozen(const std::string& path, bool verify = false);
    /// As `Snapshot::freeze`, for the newest state.
    void freeze(const std::string& path, std::string_view origin = {}, bool in_place = false) const;
    /// None unless the store is frozen.
    [[nodiscard]] std::optional<FrozenUse> frozen() const;

    /// Stores the members of a request in one commit. If it throws, nothing is stored. Throws
    /// InvalidTransform, InvalidName, InvalidStamp, TooOld, StaticConflict, RepeatedStamp or
    /// CycleError of the first invalid member, with its `index` and all invalid members in
    /// `refused`; CapacityExceeded; InvalidArgument for `only_new` with static transforms and for
    /// columns of different lengths. An empty request commits nothing.
    WriteResult write(const WriteRequest& request);
    /// Stores all of `batch`, or throws; returns the commit's number.
    CommitNumber set_transforms(std::span<const TransformView> batch, bool is_static,
                                std::string_view authority, WriteRules rules = {}) {
        return write({.transforms = batch,
                      .is_static = is_static,
                      .authority = authority,
                      .rules = rules})
            .commit;
    }
    CommitNumber set_transform(const TransformView& transform, bool is_static,
                               std::string_view authority, WriteRules rules = {}) {
        return set_transforms({&transform, 1}, is_static, authority, rules);
    }
    /// Removes a frame, if recursive with all frames below it. Throws UnknownFrame, FrameInUse.
    CommitNumber remove_frame(std::string_view name, bool recursive) {
        return remove_frames({&name, 1}, recursive);
    }
    /// Removes frames in one commit, all or none; their order does not matter, and duplicates count
    /// once. Without names it commits nothing. Throws UnknownFrame, FrameInUse (it is the newest
    /// parent of a remaining frame) of the first frame that cannot be removed, with its `index`;
    /// `refused` lists all of them. A frame that `apply` created stays, and loses the parent that a
    /// local writer stored; if there is none, throws ReadOnly.
    CommitNumber remove_frames(std::span<const std::string_view> names, bool recursive);
    /// Drops all moving samples; frames and static edges stay.
    CommitNumber clear();
    /// Returns unused memory to the system as whole pages, including samples beyond the history.
    /// Returns false and does nothing while a state older than the newest is held, or while a
    /// repeatedly overtaken read is in progress. An open transaction, and the fourth of several
    /// snapshots, may count as older than they are. The time grows with the number of samples and
    /// frames; meanwhile writes wait and reads continue. Throws ReadOnly, TransactionActive,
    /// LockTimeout, CorruptStore.
    bool compact();

    /// The commits after `since` in order, at most `limit` of them. They contain all samples that
    /// the newest state shows. While a snapshot of commit `since` or older is held, they contain
    /// all stored samples. `gone` counts missing ones. A frozen store's feed is empty. `only`: the
    /// changes of these frames and their edges, and the commits with such changes.
    ///
    /// Throws FeedLapped if the feed does not reach back that far. Its fields: `since`; the
    /// `oldest` valid commit, which is overwritten next; the `newest`; and `commit`, from which
    /// half of the feed is left. Throws InvalidArgument for a future commit, TransactionActive, and
    /// NotSupported in engines without a feed.
    [[nodiscard]] std::vector<Changes> changes(
        CommitNumber since, std::size_t limit = kNoLimit,
        std::optional<std::span<const std::string_view>> only = std::nullopt) const;
    static constexpr std::size_t kNoLimit = ~std::size_t{0};

    /// The first commits after `since` as a sample for `apply`; empty if there is none. `only`: as
    /// in `changes`. Throws FeedLapped, InvalidArgument, TransactionActive, NotSupported as
    /// `changes`. Throws Gone if a sample of these commits is no longer stored: never while a
    /// readable snapshot of commit `since` or older is held.
    [[nodiscard]] std::vector<std::byte> commits_bytes(
        CommitNumber since, SampleLimits limits = {},
        std::optional<std::span<const std::string_view>> only = std::nullopt) const;
    /// Applies a sample of another store. Each commit becomes one commit here; a state becomes one
    /// commit, which replaces the source's data. The position is part of the commit; commits up to
    /// the position are skipped. If it throws, the store has the last complete commit. Throws
    /// OutOfOrder (commits are missing, or a later epoch or another choice of frames begins without
    /// a state), Fenced (an earlier epoch), CorruptMessage, InvalidName, InvalidTransform (also: an
    /// edge twice in a commit), InvalidStamp, CycleError, FrameInUse, CapacityExceeded,
    /// InvalidArgument (prefix), NotSupported (engines other than the default), and the errors of a
    /// write.
    Position apply(std::span<const std::byte> sample, const ApplyOptions& options = {});
    /// Forgets the position of a source, in one commit; the next sample applied from it must be a
    /// state. Its frames stay until then. False: nothing was ever applied, and nothing changed.
    /// Throws as a write.
    bool forget_source(std::string_view source);
    /// Sets the position of `to.source`, in a commit of its own. None: the position is not at the
    /// epoch and commit of `from`, and nothing changed. The commit of `to` counts only for kFollow.
    /// Otherwise the position gets this store's commit: for kAdopt, the last one before the call.
    /// With `from`, kAdopt changes only the store of a home, and kFollow only other stores. Throws
    /// as a write, and InvalidArgument if the store has other sources.
    std::optional<HandedOver> hand_over(Handover how, const Position& to,
                                        const std::optional<Position>& from = std::nullopt);
    /// Positions of all sources, in the order of their first sample.
    [[nodiscard]] std::vector<Position> positions() const;
    /// The store's own epoch, which numbers its commits.
    [[nodiscard]] Epoch epoch() const;

    /// Waits until the question has an answer; a later write may remove it again. False: no answer
    /// came within the timeout (none: unlimited), or `stop_waits` was called. Throws BufferClosed
    /// (`end_waits` was called), NoSuchStore (the store was removed), InvalidName,
    /// TransactionActive, and the exceptions of an Interruption. Throws NotSupported in research
    /// engines, and if this process may not write to the store's control file.
    [[nodiscard]] bool wait_for(const Question& question,
                                std::optional<std::int64_t> timeout_ns) const;
    /// The same for a commit with a greater number, up to `last_to_follow`.
    [[nodiscard]] bool wait_for_commit(CommitNumber after,
                                       std::optional<std::int64_t> timeout_ns) const;
    /// The newest commit for a follower. After the store's removal it is the newest one at the time
    /// when this process noticed the removal, even if others still write.
    [[nodiscard]] CommitNumber last_to_follow() const;
    /// The non-blocking form, for event loops: one thread blocks in `ended_waits` for all waits.
    /// Returns the wait's number; 0: the answer already exists.
    [[nodiscard]] std::uint64_t begin_wait(const Question& question) const;
    [[nodiscard]] std::uint64_t begin_wait_for_commit(CommitNumber after) const;
    /// False: it has already ended.
    bool cancel_wait(std::uint64_t number) const;
    /// Waits until some of the begun waits end, and takes them. Empty: none ended in that time.
    [[nodiscard]] std::vector<EndedWait> ended_waits(std::optional<std::int64_t> timeout_ns) const;
    /// The same without taking them: any thread may take them by `ended_waits(0)`.
    void await_ended_waits(std::optional<std::int64_t> timeout_ns) const;
    /// Throws the error of a wait that ended in this way.
    [[noreturn]] void raise_ended_wait(WaitEnd end) const;
    /// Ends all current and future waits.
    void end_waits() const;
    /// The same as if each wait had timed out, until it is called with false.
    void stop_waits(bool stop) const;

    /// Follows frames and paths: see store/watch.hpp. Throws InvalidArgument for an empty watch,
    /// InvalidName, and the exceptions of `wait_for_commit`; NotSupported for a frozen store.
    [[nodiscard]] std::shared_ptr<Watch> watch(const Watched& watched) const;

    /// The clock of all processes that have the store open: see store/clock.hpp.
    [[nodiscard]] Clock clock() const;

    /// From now on lookups of this Buffer, its snapshots and its transactions fail with kStale if
    /// the newest sample of an edge of the path is older than its lifespan by the store's clock.
    /// The first matching lifespan counts. The path is that of the newest tree in the state that is
    /// read. Threads: one at a time, concurrently with any reads.
    void enforce(std::span<const Lifespan> lifespans);

    /// Throws TransactionActive if this thread has an open transaction of the store: a read outside
    /// of it would see another state, and validation would miss it.
    void check_not_in_transaction() const;
    [[nodiscard]] Snapshot snapshot() const;
    [[nodiscard]] MemoryUse memory() const;
    [[nodiscard]] Counters counters() const;
    [[nodiscard]] std::optional<StampNs> history() const;
    [[nodiscard]] Concurrency concurrency() const;

private:
    friend class Applier;
    friend class Transaction;
    explicit Buffer(std::shared_ptr<store::Store> store);
};

/// Applies samples of one source as `Buffer::apply`, but quicker: it remembers the frames of the
/// last one. The buffer must outlive it.
/// Threads: one at a time, `position` any. Guarantee: that of `Buffer::apply`.
class Applier {
public:
    Applier(Buffer& buffer, const ApplyOptions& options);
    ~Applier();

    Position apply(std::span<const std::byte> sample);
    /// What the commits since the last call have replaced, also if `apply` has thrown since.
    [[nodiscard]] LostParents take_lost();
    /// The source's position in the newest state. Empty if nothing of it was applied.
    [[nodiscard]] std::optional<Position> position();

private:
    std::unique_ptr<store::Applying> applying_;
};

}  // namespace tfdb
