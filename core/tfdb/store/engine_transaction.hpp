// An engine's implementation of a transaction, for TransactionLife.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tfdb/store/buffer.hpp"
#include "tfdb/store/store.hpp"
#include "tfdb/store/transaction.hpp"
#include "tfdb/store/velocity.hpp"

namespace tfdb::store {

/// An open transaction of some engine. Every call except the destructor and `rollback` may throw
/// Conflict: the transaction has then ended, and nothing was stored.
/// Threads: one. Guarantee: that of its engine.
class EngineTransaction {
public:
    EngineTransaction() = default;
    virtual ~EngineTransaction() = default;
    EngineTransaction(const EngineTransaction&) = delete;
    EngineTransaction& operator=(const EngineTransaction&) = delete;

    /// As StoreReader::ask, by name.
    [[nodiscard]] virtual bool ask(Question& question, Answer& answer, Failure& failure) = 0;
    [[nodiscard]] virtual bool has_frame(std::string_view name) = 0;
    /// As StoreReader::parent_of.
    [[nodiscard]] virtual std::optional<std::string> parent_of(std::string_view name,
                                                               std::optional<StampNs> stamp) = 0;
    /// As the reads of these names. False: `failure` has the reason.
    [[nodiscard]] virtual bool velocity(const VelocityQuestion& question, Twist& twist,
                                        Asked& asked, Failure& failure) = 0;
    [[nodiscard]] virtual bool path_stamps(std::string_view target, std::string_view source,
                                           std::optional<StampNs> start, std::optional<StampNs> end,
                                           std::vector<StampNs>& stamps, Failure& failure) = 0;
    [[nodiscard]] virtual std::vector<std::string> all_frames() = 0;
    [[nodiscard]] virtual FrameInfo frame_info(std::string_view name) = 0;
    [[nodiscard]] virtual std::vector<FrameInfo> tree(std::optional<StampNs> stamp) = 0;
    [[nodiscard]] virtual Samples samples(std::string_view name) = 0;
    /// The commit whose state it reads.
    [[nodiscard]] virtual CommitNumber read_as_of() = 0;
    [[nodiscard]] virtual std::string frame_name(FrameId id, std::uint32_t generation) const = 0;
    /// As store::did_you_mean, with the frames visible to the transaction in the state of `commit`.
    [[nodiscard]] virtual std::string did_you_mean(std::string_view name,
                                                   CommitNumber commit) const = 0;

    virtual void write(std::span<const TransformView> batch, bool is_static,
                       std::string_view authority) = 0;
    virtual void remove_frames(std::span<const std::string_view> names, bool recursive) = 0;
    virtual void clear() = 0;

    /// Ends it. Throws Conflict, CycleError, CapacityExceeded.
    virtual CommitNumber commit() = 0;
    virtual void rollback() noexcept = 0;
};

/// Begins one in the store's engine; `options` were checked, and `age` is set.
[[nodiscard]] std::unique_ptr<EngineTransaction> make_transaction(
    Store& store, const TransactionOptions& options);

}  // namespace tfdb::store
