#include "tfdb/store/apply_order.hpp"

#include <cstdio>

#include "tfdb/store/positions.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb::store {
namespace {

using wire::CommitSample;

constexpr const char* kStateFirst = ": apply a state of the source (state_bytes) first";

std::string text_of(const Epoch& epoch) {
    char id[33];
    (void)std::snprintf(id, sizeof id, "%016llx%016llx",
                        static_cast<unsigned long long>(epoch.high),
                        static_cast<unsigned long long>(epoch.low));
    return std::to_string(epoch.number) + "-" + id;
}

}  // namespace

void ApplyOrder::check() const {
    if (is_same_epoch() && position_->choice == Positions::kReleased) {
        throw InvalidArgument("the home of " + quoted(source_) +
                              " publishes this same store: mirror it into another store");
    }
    if (position_ && sample_.epoch < position_->epoch) {
        throw Fenced("epoch " + text_of(sample_.epoch) + " of source " + quoted(source_) +
                         " has ended: commits of epoch " + text_of(position_->epoch) +
                         " have been applied; if its clock was set back, call forget_source(" +
                         quoted(source_) + "), then apply a state",
                     detail());
    }
    if (sample_.kind == CommitSample::Kind::kState)
        check_state();
    else if (!position_)
        check_first();
    else
        check_commits();
}

void ApplyOrder::check_state() const {
    if (is_same_epoch() && !goes_on() && sample_.last < position_->commit) {
        refuse("the state of commit " + std::to_string(sample_.last) + " of source " +
               quoted(source_) + " is older than commit " + std::to_string(position_->commit) +
               ", which has been applied" + other_frames() + ": apply a newer state");
    }
}

void ApplyOrder::check_first() const {
    if (sample_.since != 0) {
        refuse("nothing of source " + quoted(source_) +
               " has been applied yet, these are the commits after " +
               std::to_string(sample_.since) + kStateFirst);
    }
}

void ApplyOrder::check_commits() const {
    if (position_->epoch == Epoch{})
        refuse("source " + quoted(source_) + " was forgotten" + kStateFirst);
    if (!is_same_epoch()) {
        refuse("epoch " + text_of(sample_.epoch) + " of source " + quoted(source_) +
               " is later than " + text_of(position_->epoch) + kStateFirst);
    }
    if (!goes_on()) {
        refuse("source " + quoted(source_) + " was applied" + other_frames() +
               ": apply a state (state_bytes) of those that are wanted now first");
    }
    if (sample_.since > position_->commit) {
        refuse("commits " + std::to_string(position_->commit + 1) + " to " +
               std::to_string(sample_.since) + " of source " + quoted(source_) +
               " are missing: apply them first, or a state");
    }
}

const char* ApplyOrder::other_frames() const {
    return choice_ >> kSharedShift != position_->choice >> kSharedShift
               ? " with other shared frames (shared=)"
               : " with other frames (frames=)";
}

ErrorDetail ApplyOrder::detail() const {
    ErrorDetail detail;
    detail.since = sample_.since;
    if (position_)
        detail.commit = position_->commit;
    return detail;
}

void ApplyOrder::refuse(const std::string& why) const {
    throw OutOfOrder(why, detail());
}

}  // namespace tfdb::store
