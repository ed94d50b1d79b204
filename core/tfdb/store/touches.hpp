// Which commits touched some frames and paths, read from the feed.
#pragma once

#include <array>
#include <string>
#include <unordered_map>
#include <vector>

#include "tfdb/store/feed_notes.hpp"
#include "tfdb/store/path_frames.hpp"
#include "tfdb/store/watch.hpp"

namespace tfdb::store {

/// Keeps, for each subject of a watch, the frames that it consists of in one state. A commit that
/// notes one of them touches the subject, which is then found anew in the state behind that commit.
/// A subject that cannot be found there, or depends on the stamp, consists of every commit.
/// Threads: one at a time. Guarantee: as Watch.
class Touches {
public:
    Touches(const Store& store, const Watched& watched);

    /// Finds the subjects in the state of a commit, unless nothing was touched between that and
    /// theirs. Throws InvalidArgument for one that does not exist yet.
    void begin(CommitNumber after);
    /// What the subjects consist of: sorted, each once.
    [[nodiscard]] const std::vector<FrameId>& frames();
    /// The commits after `after`, to `until`, touched none of that.
    void skip(CommitNumber after, CommitNumber until);
    /// The later commits that touched something, at most `limit` of them. Throws FeedLapped.
    [[nodiscard]] std::vector<Touch> read(std::size_t limit);

private:
    using Place = std::uint32_t;
    enum class Kind : std::uint8_t { kFrame, kPair, kEvery };
    struct Subject {
        std::array<std::string, 2> names;  // of a frame: the first
        Kind kind;
        std::vector<FrameId> frames{};
    };

    [[nodiscard]] std::vector<Place> judge(CommitNumber commit);
    [[nodiscard]] static bool is_missing(const Subject& subject);
    void find(Place place, CommitNumber commit);
    [[nodiscard]] lookup::Outcome find_in(const StoreView& view, const Subject& subject,
                                          std::vector<FrameId>& frames) const;

    const Store& store_;
    std::vector<Subject> subjects_;
    std::unordered_map<FrameId, std::vector<Place>> places_;  // none is empty
    // The subjects are those of these states; no commit after the first of them touched one.
    CommitNumber from_ = 1;
    CommitNumber until_ = 0;  // less: of none
    FeedNotes notes_;
    std::vector<FrameId> frames_;  // none: to be collected
};

}  // namespace tfdb::store
