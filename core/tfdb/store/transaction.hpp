// Read, decide, write: a transaction over the store, as if it ran alone.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tfdb/store/buffer.hpp"

namespace tfdb {

namespace store {
class TransactionLife;
}

struct TransactionOptions {
    static constexpr unsigned kMaxPriority = 7;
    static constexpr unsigned kAgeBits = 60;

    /// 0 to kMaxPriority. Above 0 it commits before ordinary writers; in wait-die and wound-wait
    /// the higher priority is senior.
    unsigned priority = 0;
    /// Excludes all other commits from begin to end: it has no conflicts, and writers wait for it.
    bool alone = false;
    /// `age()` of the aborted attempt, so that a restart keeps its seniority. 0: a new one.
    std::uint64_t age = 0;
};

/// One attempt to read and write as if alone. Reads see one state of the store, overlaid with the
/// transaction's own writes; `commit` makes all writes visible at once.
/// Threads: only the one that began it (WrongThread); the end of that thread aborts it. Meanwhile
/// that thread must not write to the Buffer or begin another transaction (TransactionActive).
/// Guarantee: strictly serializable, in every engine except `fine`. Conflict: another commit came
/// first, nothing was stored and the transaction has ended; run it again.
class Transaction : public store::LookupsByName<Transaction> {
public:
    /// The stage of a transaction.
    enum class Stage : std::uint8_t { kNotBegun, kOpen, kCommitted, kAborted, kLost, kRefused };
    /// Tag: `begin` starts the transaction later.
    struct BeginLater {};

    /// Throws InvalidArgument (priority), TransactionActive. Blocks as the engine does.
    explicit Transaction(Buffer& buffer, const TransactionOptions& options = {});
    /// Throws InvalidArgument.
    Transaction(Buffer& buffer, const TransactionOptions& options, BeginLater);
    /// Aborts an open transaction.
    ~Transaction();
    Transaction(const Transaction&) = delete;
    Transaction& operator=(const Transaction&) = delete;

    /// Makes the calling thread its owner. Throws TransactionActive, TransactionClosed,
    /// WrongThread. Blocks as the engine does.
    void begin();

    /// As StoreReader::ask; frames may be the transaction's own. Throws Conflict,
    /// TransactionClosed, WrongThread, as do all methods below.
    [[nodiscard]] bool ask(Question& question, Answer& answer, Failure& failure) const;
    using LookupsByName::ask;
    /// Rows of T[target<-source] at each stamp, as StoreReader::lookup_many.
    void lookup_many(std::string_view target, std::string_view source,
                     std::span<const StampNs> stamps, Policy policy, Layout layout, Missing missing,
                     std::span<double> out);
    /// As in StoreReader.
    template <class Real>
    void lookup_edges(std::span<FrameRef> frames, std::optional<StampNs> stamp, Policy policy,
                      Missing missing, std::span<Real> out) const;
    [[nodiscard]] std::optional<std::string> parent_of(std::string_view name,
                                                       std::optional<StampNs> stamp = std::nullopt);
    [[nodiscard]] bool has_frame(std::string_view name);
    /// As in StoreReader. A listing of all frames depends on each of them, and on the absence of
    /// new ones.
    template <class Real>
    void transform_points(std::string_view target, std::string_view source, const Real* points,
                          std::size_t stride, std::size_t count, std::span<const StampNs> stamps,
                          Policy policy, Missing missing, Real* out, std::size_t out_stride);
    [[nodiscard]] Twist lookup_velocity(std::string_view target, std::string_view source,
                                        std::optional<StampNs> stamp, StampNs interval,
                                        std::string_view reference, geometry::Vec3 point,
                                        std::string_view point_frame);
    [[nodiscard]] std::vector<StampNs> path_stamps(std::string_view target, std::string_view source,
                                                   std::optional<StampNs> start,
                                                   std::optional<StampNs> end);
    [[nodiscard]] std::vector<std::string> frames();
    [[nodiscard]] FrameInfo frame_info(std::string_view name);
    [[nodiscard]] std::vector<FrameInfo> tree(std::optional<StampNs> stamp = std::nullopt);
    [[nodiscard]] TreeColumns tree_columns(std::optional<StampNs> stamp = std::nullopt);
    [[nodiscard]] Samples samples(std::string_view name);
    /// Throws the typed error of a failed question.
    [[noreturn]] void raise(const Failure& failure, const Question& question) const;
    /// Name of a frame in an answer of this transaction, including its own new frames.
    [[nodiscard]] std::string frame_name(FrameId id, std::uint32_t generation) const;

    /// Keeps the writes until `commit`. Throws as Buffer::set_transforms, except that CycleError
    /// comes from the commit. A refused batch leaves the transaction unchanged.
    void set_transforms(std::span<const TransformView> batch, bool is_static,
                        std::string_view authority);
    /// As Buffer::remove_frames, at the commit. Throws UnknownFrame, FrameInUse; the commit throws
    /// ReadOnly for every frame that Buffer::apply created.
    void remove_frames(std::span<const std::string_view> names, bool recursive);
    void remove_frame(std::string_view name, bool recursive) {
        remove_frames({&name, 1}, recursive);
    }
    /// As Buffer::clear, at the commit: it drops the store's moving samples at that time, and those
    /// that this transaction has written so far. Later writes are stored.
    void clear();
    /// Gives `child` another parent from `stamp` on (none: a static edge). Without a pose, its
    /// current pose is kept: T[parent<-child] at the stamp, as this transaction sees it. Throws as
    /// the lookup or set_transforms.
    void reparent(std::string_view child, std::string_view parent, std::optional<StampNs> stamp,
                  const std::optional<Pose>& pose, std::string_view authority);

    /// Makes the writes visible at once; returns the commit's number (of the state that was read,
    /// if nothing was written). Throws Conflict, CycleError, CapacityExceeded: the transaction has
    /// then ended and the store is unchanged.
    CommitNumber commit();
    /// Discards all writes. Does nothing if the transaction has ended.
    void abort() noexcept;
    [[nodiscard]] Stage stage() const noexcept;
    [[nodiscard]] bool is_open() const noexcept { return stage() == Stage::kOpen; }
    /// The return value of `commit`.
    [[nodiscard]] CommitNumber committed() const noexcept;
    /// Whether `committed` is its own commit, not the state that it read.
    [[nodiscard]] bool has_written() const noexcept;
    /// The conflict that aborted it.
    [[nodiscard]] const std::optional<Conflict>& lost_to() const noexcept;
    [[nodiscard]] std::uint64_t age() const noexcept;
    /// Throws the errors of every use: Forked, WrongThread, TransactionClosed.
    void check() const;
    /// Throws WrongThread.
    void check_thread() const;

    /// Aborts this thread's open transactions, for a thread that will never continue.
    static void end_thread() noexcept;

private:
    struct Release {
        void operator()(store::TransactionLife* life) const noexcept;
    };
    std::unique_ptr<store::TransactionLife, Release> life_;
};

}  // namespace tfdb
