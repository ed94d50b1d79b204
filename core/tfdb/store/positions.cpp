#include "tfdb/store/positions.hpp"

#include <algorithm>

#include "tfdb/graph/names.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb::store {

std::size_t Positions::size_of(Record record, unsigned w) const {
    return std::min<std::size_t>(load(record, w), kMaxNameBytes);
}

std::string Positions::source(Record record) const {
    return graph::load_text(region_, record + 8 * Offset{kTexts}, size_of(record, kSourceSize));
}

std::string Positions::prefix(Record record) const {
    const Offset behind = (size_of(record, kSourceSize) + 7) / 8;
    return graph::load_text(region_, record + 8 * (kTexts + behind), size_of(record, kPrefixSize));
}

std::uint64_t Positions::number(Record record) const {
    return load(record, kNumber);
}

Positions::Record Positions::find(std::string_view source) {
    if (const auto known = known_.find(std::string(source)); known != known_.end())
        return known->second;
    const Record found = search(source);
    if (found != 0)
        known_.emplace(source, found);
    return found;
}

Positions::Record Positions::search(std::string_view source) const {
    Record found = 0;
    for_each([&](Record record) {
        found = this->source(record) == source ? record : 0;
        return found == 0;
    });
    return found;
}

Positions::Record Positions::make(std::string_view source, std::string_view prefix) {
    std::uint64_t last = 0;
    for_each([&](Record record) {
        last = std::max(last, number(record));
        const std::string other = this->prefix(record);
        if (other.starts_with(prefix) || prefix.starts_with(other)) {
            throw InvalidArgument("prefix " + quoted(prefix) + " of source " + quoted(source) +
                                  " overlaps prefix " + quoted(other) + " of source " +
                                  quoted(this->source(record)) +
                                  ": neither may be the beginning of the other");
        }
        return true;
    });
    if (last >= kMost - 1) {
        throw CapacityExceeded("the store already has positions of " + std::to_string(last) +
                               " sources, the limit");
    }
    const Record record = region_.allocate(bytes(source.size(), prefix.size()));
    for (unsigned w = 0; w < kTexts; ++w)
        word(record, w).store_relaxed(0);
    word(record, kNext).store_relaxed(first_.load_relaxed());
    word(record, kNumber).store_relaxed(last + 1);
    word(record, kSourceSize).store_relaxed(source.size());
    word(record, kPrefixSize).store_relaxed(prefix.size());
    graph::store_text(region_, record + 8 * Offset{kTexts}, source);
    graph::store_text(region_, record + 8 * (kTexts + (source.size() + 7) / 8), prefix);
    first_.store_release(record);
    return record;
}

unsigned Positions::valid_slot(Record record, CommitNumber committed) const {
    unsigned found = kNone;
    CommitNumber latest = 0;
    for (const unsigned slot : {kFirstSlot, kSecondSlot}) {
        const CommitNumber from = word(record, slot + kValidFrom).load_acquire();
        if (from != 0 && from <= committed && from >= latest) {
            latest = from;
            found = slot;
        }
    }
    return found;
}

std::optional<Position> Positions::position(Record record) const {
    for (;;) {
        const unsigned slot = valid_slot(record, commit_.load_acquire());
        if (slot == kNone)
            return std::nullopt;
        const std::uint64_t from = word(record, slot + kValidFrom).load_acquire();
        Position found;
        found.epoch = {load(record, slot + kEpochNumber), load(record, slot + kEpochHigh),
                       load(record, slot + kEpochLow)};
        found.commit = load(record, slot + kCommit);
        found.choice = load(record, slot + kChoice);
        sync::fence_acquire();
        // A writer takes this slot only once the other slot counts.
        if (load(record, slot + kValidFrom) != from)
            continue;
        found.source = source(record);
        found.prefix = prefix(record);
        return found;
    }
}

std::vector<Position> Positions::all() const {
    std::vector<Position> all;
    for_each([&](Record record) {
        if (auto found = position(record); found && found->epoch != Epoch{})
            all.push_back(*std::move(found));
        return true;
    });
    std::reverse(all.begin(), all.end());
    return all;
}

void Positions::set(Record record, const Epoch& epoch, CommitNumber commit, std::uint64_t choice) {
    const CommitNumber committed = commit_.load_relaxed();
    const unsigned counts = valid_slot(record, committed);
    const unsigned slot = counts == kFirstSlot ? kSecondSlot : kFirstSlot;
    word(record, slot + kValidFrom).store_relaxed(0);
    sync::fence_release();
    word(record, slot + kEpochNumber).store_relaxed(epoch.number);
    word(record, slot + kEpochHigh).store_relaxed(epoch.high);
    word(record, slot + kEpochLow).store_relaxed(epoch.low);
    word(record, slot + kCommit).store_relaxed(commit);
    word(record, slot + kChoice).store_relaxed(choice);
    word(record, slot + kValidFrom).store_release(committed + 1);
}

std::optional<std::string> Positions::owner(std::uint64_t number) const {
    std::optional<std::string> found;
    for_each([&](Record record) {
        if (this->number(record) != number)
            return true;
        const auto position = this->position(record);
        if (position && position->epoch != Epoch{} && position->choice != kReleased)
            found = position->source;
        return false;
    });
    return found;
}

void Positions::repair() {
    const CommitNumber committed = commit_.load_relaxed();
    for_each([&](Record record) {
        for (const unsigned slot : {kFirstSlot, kSecondSlot}) {
            if (load(record, slot + kValidFrom) > committed)
                word(record, slot + kValidFrom).store_relaxed(0);
        }
        return true;
    });
}

std::uint64_t Positions::source_of(CommitNumber commit) const {
    std::uint64_t found = 0;
    for_each([&](Record record) {
        for (const unsigned slot : {kFirstSlot, kSecondSlot}) {
            if (commit != 0 && load(record, slot + kValidFrom) == commit)
                found = number(record);
        }
        return found == 0;
    });
    return found;
}

}  // namespace tfdb::store
