// Whether a sample of another store follows the position up to which that store was applied.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "tfdb/store/buffer.hpp"
#include "tfdb/wire/commit_sample.hpp"

namespace tfdb::store {

/// The digest of the shared frames lies above that of the chosen frames: see Position::choice.
inline constexpr unsigned kSharedShift = 32;

/// Checks whether commits between a position and a sample of these options may be missing.
/// Threads: one. Guarantee: changes nothing.
class ApplyOrder {
public:
    ApplyOrder(const wire::CommitSample& sample, std::uint64_t choice, std::string_view source,
               const std::optional<Position>& position)
        : sample_(sample), choice_(choice), source_(source), position_(position) {}

    [[nodiscard]] bool is_same_epoch() const {
        return position_ && sample_.epoch == position_->epoch;
    }
    /// Whether position and sample belong to one copy.
    [[nodiscard]] bool goes_on() const { return is_same_epoch() && choice_ == position_->choice; }
    /// Throws Fenced, InvalidArgument, OutOfOrder.
    void check() const;

private:
    /// A state with other frames may be of the position's commit, but not of an earlier one.
    void check_state() const;
    void check_first() const;
    void check_commits() const;
    [[nodiscard]] const char* other_frames() const;
    [[nodiscard]] ErrorDetail detail() const;
    [[noreturn]] void refuse(const std::string& why) const;

    const wire::CommitSample& sample_;
    std::uint64_t choice_;
    std::string_view source_;
    const std::optional<Position>& position_;
};

}  // namespace tfdb::store
