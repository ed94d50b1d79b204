// The change feed: the frames that each commit touched, in a ring of words in the region.
//
// An index has one word per commit: the ring position of its notes, and their number of words. A
// commit notes a frame before it changes the frame, and the index word counts each note at once. So
// after a writer's death, the entry after the last commit names every frame that the dead commit
// may have touched. The counts in notes are corrected just before the commit is published. The next
// commit reuses the place of a commit that was rolled back.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "tfdb/graph/frames.hpp"

namespace tfdb::txn {

/// Sizes of the feed. Tests that explore every interleaving specialise them to be tiny.
template <class Memory>
struct FeedTuning {
    static constexpr unsigned kCommitsLog2 = 14;
    static constexpr unsigned kWordsLog2 = 16;
};

/// Index word of a commit: position of its first word << 20
/// number of words.
struct FeedEntry {
    static constexpr std::uint64_t kTooLarge = kNoFrame;  // more than the ring can hold

    static constexpr std::uint64_t pack(std::uint64_t first, std::uint64_t words) {
        return first << kFrameBits | words;
    }
    static constexpr std::uint64_t first(std::uint64_t entry) { return entry >> kFrameBits; }
    static constexpr std::uint64_t words(std::uint64_t entry) { return entry & kNoFrame; }
    static constexpr std::uint64_t end(std::uint64_t entry) { return first(entry) + words(entry); }
};

/// First word of a note: count << 40
/// authority << 24
/// what << 20
/// frame. It counts samples; for a removal, the bytes of the name, which follow in words.
struct FeedNote {
    enum What : unsigned {
        kMade = 1,
        kMoved = 2,    // its newest parent changed or went away
        kCleared = 4,  // its samples were dropped, before the counted ones were stored
        kRemoved = 8,
    };
    static constexpr unsigned kWhatBits = 4;
    static constexpr unsigned kAuthorityBits = 16;
    static constexpr unsigned kCountShift = kFrameBits + kWhatBits + kAuthorityBits;
    /// This count means: that many samples or more.
    static constexpr std::uint64_t kMostSamples = ~std::uint64_t{0} >> kCountShift;

    /// `authority`: number of the samples' authority.
    static constexpr std::uint64_t pack(FrameId id, unsigned what, std::uint64_t count,
                                        std::uint64_t authority = 0) {
        return std::min(count, kMostSamples) << kCountShift |
               authority << (kFrameBits + kWhatBits) | std::uint64_t{what} << kFrameBits | id;
    }
    static constexpr FrameId id(std::uint64_t note) {
        return static_cast<FrameId>(note & kNoFrame);
    }
    static constexpr unsigned what(std::uint64_t note) {
        return static_cast<unsigned>(note >> kFrameBits) & ((1U << kWhatBits) - 1);
    }
    static constexpr std::uint64_t authority(std::uint64_t note) {
        return note >> (kFrameBits + kWhatBits) & ((1U << kAuthorityBits) - 1);
    }
    static constexpr std::uint64_t count(std::uint64_t note) { return note >> kCountShift; }
    static constexpr std::uint64_t name_words(std::uint64_t note) { return (count(note) + 7) / 8; }
};

/// The location of the feed's words.
/// Threads: any; it is a value. Guarantee: wait-free.
template <class Memory>
class Feed {
public:
    static constexpr std::uint64_t kCommits = std::uint64_t{1} << FeedTuning<Memory>::kCommitsLog2;
    static constexpr std::uint64_t kWords = std::uint64_t{1} << FeedTuning<Memory>::kWordsLog2;
    static constexpr std::size_t kBytes = 8 * (kCommits + kWords);
    static_assert(kWords < FeedEntry::kTooLarge);

    explicit Feed(const graph::Frames<Memory>& frames)
        : frames_(frames),
          block_(memory::inside(frames.memory(), frames.store_word(graph::kFeed).load_relaxed())) {}

    /// Adds a feed to a store without commits; the block's words are zero.
    static void put_into(const graph::Frames<Memory>& frames, Offset block) {
        frames.store_word(graph::kFeedFloor).store_relaxed(1);
        frames.store_word(graph::kFeedLimit).store_relaxed(kWords);
        frames.store_word(graph::kFeed).store_relaxed(block);
    }

    /// False: the store has no feed.
    [[nodiscard]] bool is_kept() const { return block_ != 0; }
    [[nodiscard]] typename Memory::Word& entry(CommitNumber commit) const {
        return frames_.memory().word(block_ + 8 * (commit & (kCommits - 1)));
    }
    [[nodiscard]] typename Memory::Word& word(std::uint64_t position) const {
        return frames_.memory().word(block_ + 8 * (kCommits + (position & (kWords - 1))));
    }
    /// The oldest commit that the ring holds completely, or the next commit if it holds none. It is
    /// raised before a word of an older commit is overwritten.
    [[nodiscard]] typename Memory::Word& floor() const {
        return frames_.store_word(graph::kFeedFloor);
    }
    /// Writes up to this position overwrite no complete commit.
    [[nodiscard]] typename Memory::Word& limit() const {
        return frames_.store_word(graph::kFeedLimit);
    }

    /// Copies the notes of the published commits from `first` to `last`: their words in a row, and
    /// the end of each commit's words. False: some were overwritten.
    [[nodiscard]] bool read(CommitNumber first, CommitNumber last,
                            std::vector<std::uint64_t>& words,
                            std::vector<std::size_t>& ends) const {
        words.clear();
        ends.clear();
        if (last - first >= kCommits || last > kMaxCommit)
            return false;
        std::vector<std::uint64_t> entries;
        for (CommitNumber commit = first; commit <= last; ++commit)
            entries.push_back(entry(commit).load_relaxed());
        if (!is_whole(first))
            return false;
        for (const std::uint64_t found : entries) {
            // Only a damaged word claims more than the ring holds.
            if (words.size() + FeedEntry::words(found) > kWords)
                return false;
            for (std::uint64_t at = FeedEntry::first(found); at < FeedEntry::end(found); ++at)
                words.push_back(word(at).load_relaxed());
            ends.push_back(words.size());
        }
        return is_whole(first);
    }

    /// Calls visit(note) for the newest commit's notes, unless they exceed the ring. Only for the
    /// holder of the commit lock.
    template <class Visit>
    void visit_newest(CommitNumber commit, Visit visit) const {
        if (!is_kept() || floor().load_relaxed() > commit)
            return;
        const std::uint64_t entry = this->entry(commit).load_relaxed();
        const std::uint64_t words = FeedEntry::words(entry);
        if (words > kWords)
            return;
        for (std::uint64_t at = FeedEntry::first(entry); at < FeedEntry::end(entry);) {
            const std::uint64_t note = word(at++).load_relaxed();
            visit(note);
            if ((FeedNote::what(note) & FeedNote::kRemoved) != 0)
                at += FeedNote::name_words(note);
        }
    }

private:
    /// Whether the words of this commit and later ones were complete when they were read.
    [[nodiscard]] bool is_whole(CommitNumber first) const {
        Memory::fence_acquire();
        return floor().load_relaxed() <= first;
    }

    graph::Frames<Memory> frames_;
    Offset block_;
};

/// Notes the frames that one commit touches.
/// Threads: only the holder of the commit lock. Guarantee: wait-free; allocates nothing.
template <class Memory>
class FeedWriter {
public:
    /// `committed`: the newest published commit.
    FeedWriter(const graph::Frames<Memory>& frames, CommitNumber committed)
        : feed_(frames), commit_(committed + 1) {
        if (!feed_.is_kept())
            return;
        at_ = FeedEntry::end(feed_.entry(committed).load_relaxed());
        limit_ = feed_.limit().load_relaxed();
        entry_ = FeedEntry::pack(at_, 0);
        if (commit_ >= Words::kCommits && feed_.floor().load_relaxed() <= commit_ - Words::kCommits)
            raise_floor(commit_ - Words::kCommits + 1);
        feed_.entry(commit_).store_release(entry_);
    }

    /// Call before the frame is changed. Returns the note's position.
    std::uint64_t note(FrameId id, unsigned what, std::uint64_t count, std::uint64_t authority) {
        const std::uint64_t position = at_;
        put(FeedNote::pack(id, what, count, authority));
        return position;
    }
    /// The same for a frame that is to be removed. `name_word(i)`: eight bytes of its name.
    template <class NameWord>
    void note_removal(FrameId id, std::uint64_t name_bytes, NameWord name_word) {
        const std::uint64_t note = FeedNote::pack(id, FeedNote::kRemoved, name_bytes);
        put(note);
        for (std::uint64_t i = 0; i < FeedNote::name_words(note); ++i)
            put(name_word(i));
    }
    /// Call before the commit is published: stores the final note.
    void correct(std::uint64_t position, FrameId id, unsigned what, std::uint64_t count,
                 std::uint64_t authority) {
        if (position < at_)
            feed_.word(position).store_relaxed(FeedNote::pack(id, what, count, authority));
    }

private:
    using Words = Feed<Memory>;
    /// The space that is freed at a time.
    static constexpr std::uint64_t kRoom = std::max<std::uint64_t>(1, Words::kWords / 64);

    void put(std::uint64_t word) {
        // A store without a feed has no space.
        if (at_ >= limit_ && !make_room()) [[unlikely]]
            return;
        feed_.word(at_++).store_relaxed(word);
        feed_.entry(commit_).store_release(++entry_);
    }
    void raise_floor(CommitNumber floor) {
        feed_.floor().store_relaxed(floor);
        Memory::fence_release();
    }

    /// Drops the oldest commits. False: this commit exceeds the ring, or none is left to drop.
    [[nodiscard, gnu::noinline]] bool make_room() {
        if (!feed_.is_kept() || FeedEntry::words(entry_) == FeedEntry::kTooLarge)
            return false;
        const std::uint64_t first = FeedEntry::first(entry_);
        // Only damage can put it further back.
        const CommitNumber oldest = commit_ - std::min(commit_, Words::kCommits);
        CommitNumber floor = std::max<CommitNumber>(feed_.floor().load_relaxed(), oldest);
        const auto end_of_room = [&] {
            const bool any = floor < commit_;
            return Words::kWords +
                   (any ? FeedEntry::first(feed_.entry(floor).load_relaxed()) : first);
        };
        while (floor < commit_ && end_of_room() < at_ + kRoom)
            ++floor;
        limit_ = end_of_room();
        const bool fits = at_ < limit_;
        if (!fits) {
            floor = commit_ + 1;
            entry_ = FeedEntry::pack(first, FeedEntry::kTooLarge);
            feed_.entry(commit_).store_release(entry_);
        }
        // After a death between the two stores, the next writer must not overwrite valid words.
        raise_floor(floor);
        feed_.limit().store_relaxed(limit_);
        return fits;
    }

    Words feed_;
    CommitNumber commit_;
    std::uint64_t entry_ = 0;  // its index word
    std::uint64_t at_ = 0;     // position of the next note
    std::uint64_t limit_ = 0;
};

}  // namespace tfdb::txn
