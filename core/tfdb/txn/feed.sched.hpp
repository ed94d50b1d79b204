// A feed that wraps around within a few commits, for the walker and for Relacy: one writer, and a
// reader that finds exactly the notes of each commit, or that they were overwritten.
#pragma once

#include <algorithm>
#include <vector>

#include "tfdb/graph/frames.hpp"
#include "tfdb/txn/feed.hpp"

namespace tfdb::txn::feed {

/// A commit of a script. One that is aborted takes no number.
struct Step {
    std::vector<FrameId> frames;  // ascending; the last one is removed on request
    bool aborted = false;
    bool removes = false;
};

struct Script {
    std::vector<Step> before;
    std::vector<Step> during;
};

inline constexpr FrameId kFrames = 8;
inline constexpr std::uint64_t kNameBytes = 11;
inline constexpr std::uint64_t kAuthor = 65'535;

inline std::uint64_t name_word(FrameId id, std::uint64_t i) {
    return 1000 + 10 * std::uint64_t{id} + i;
}

/// The words that a reader must find for a commit.
inline std::vector<std::uint64_t> words_of(const Step& step) {
    std::vector<std::uint64_t> words;
    for (const FrameId id : step.frames) {
        if (step.removes && id == step.frames.back()) {
            words.push_back(FeedNote::pack(id, FeedNote::kRemoved, kNameBytes));
            words.insert(words.end(), {name_word(id, 0), name_word(id, 1)});
        } else {
            words.push_back(FeedNote::pack(id, FeedNote::kMoved, id + 1, kAuthor));
        }
    }
    return words;
}

/// Indexed by commit.
inline std::vector<std::vector<std::uint64_t>> expected_of(const Script& script) {
    std::vector<std::vector<std::uint64_t>> expected(1);
    for (const auto* steps : {&script.before, &script.during}) {
        for (const Step& step : *steps) {
            if (!step.aborted)
                expected.push_back(words_of(step));
        }
    }
    return expected;
}

// The store words that a feed needs, and one word per frame with the commit that changed it. One
// writer at a time applies steps; readers are other threads.
template <class Memory>
struct Store {
    Memory memory;
    Offset root = memory.allocate(graph::kStoreBytes);
    graph::Frames<Memory> frames{memory, root, 0, kFrames};
    Offset block = memory.allocate(Feed<Memory>::kBytes);
    Offset changes = memory.allocate(8 * kFrames);

    Store() { Feed<Memory>::put_into(frames, block); }

    [[nodiscard]] typename Memory::Word& commit() const {
        return frames.store_word(graph::kCommit);
    }
    [[nodiscard]] typename Memory::Word& changed(FrameId id) const {
        return memory.word(changes + 8 * Offset{id});
    }

    void apply(const Step& step) {
        const CommitNumber committed = commit().load_relaxed();
        FeedWriter<Memory> writer(frames, committed);
        const auto goes = [&](FrameId id) { return step.removes && id == step.frames.back(); };
        std::vector<std::uint64_t> notes;
        for (const FrameId id : step.frames) {
            if (goes(id))
                writer.note_removal(id, kNameBytes,
                                    [id](std::uint64_t i) { return name_word(id, i); });
            else
                notes.push_back(writer.note(id, 0, 1, kAuthor));
            changed(id).store_release(committed + 1);
        }
        if (step.aborted) {
            for (const FrameId id : step.frames)
                changed(id).store_release(0);
            return;
        }
        for (std::size_t i = 0; i < notes.size(); ++i)
            writer.correct(notes[i], step.frames[i], FeedNote::kMoved, step.frames[i] + 1, kAuthor);
        commit().store_release(committed + 1);
    }

    /// Follows from a commit. Calls `require(holds, text)` for each promise.
    template <class Require>
    void follow(CommitNumber since, const std::vector<std::vector<std::uint64_t>>& expected,
                const Require& require) const {
        const CommitNumber newest = commit().load_acquire();
        if (newest <= since)
            return;
        const Feed<Memory> feed(frames);
        std::vector<std::uint64_t> words;
        std::vector<std::size_t> ends;
        if (!feed.read(since + 1, newest, words, ends)) {
            require(
                feed.floor().load_relaxed() > since + 1 || newest - since > Feed<Memory>::kCommits,
                "only what is below the floor is refused");
            return;
        }
        require(ends.size() == newest - since, "each commit once");
        std::size_t at = 0;
        for (std::size_t i = 0; i < ends.size(); ++i) {
            const auto& wanted = expected[since + 1 + i];
            require(ends[i] - at == wanted.size() &&
                        std::equal(wanted.begin(), wanted.end(), words.begin() + at),
                    "what the commit noted, whole");
            at = ends[i];
        }
    }

    /// After a writer's death, the entry behind the commit word names its changes.
    template <class Require>
    void judge_death(const Require& require) const {
        const CommitNumber dead = commit().load_relaxed() + 1;
        const Feed<Memory> feed(frames);
        const std::uint64_t entry = feed.entry(dead).load_relaxed();
        for (FrameId id = 0; id < kFrames; ++id) {
            if (changed(id).load_relaxed() != dead)
                continue;
            bool noted = FeedEntry::words(entry) == FeedEntry::kTooLarge;
            for (std::uint64_t p = FeedEntry::first(entry); !noted && p < FeedEntry::end(entry);) {
                const std::uint64_t note = feed.word(p++).load_relaxed();
                noted = FeedNote::id(note) == id;
                if ((FeedNote::what(note) & FeedNote::kRemoved) != 0)
                    p += FeedNote::name_words(note);
            }
            require(noted, "a frame is noted before it is changed");
        }
    }
};

}  // namespace tfdb::txn::feed
