// Watches: which commits touched some frames or paths.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tfdb/base/types.hpp"

namespace tfdb {

namespace store {

struct Store;

}  // namespace store

/// What a watch is of: names of frames, and pairs (target, source) that stand for their path. Any
/// of the frames may be missing yet.
struct Watched {
    std::vector<std::string> frames;
    std::vector<std::pair<std::string, std::string>> pairs;
    bool every_commit = false;
};

/// A commit, and what it touched.
struct Touch {
    CommitNumber commit = 0;
    // Places in `Watched`, ascending: frames, then pairs, then every commit.
    std::vector<std::uint32_t> what;
};

/// Frames and paths whose commits a follower wants. A commit touches a frame if it stores samples
/// of it, moves, clears, makes or removes it. It touches a pair if it touches a frame of its path,
/// as the newest parents give it before the commit or after it: the frames below where target and
/// source meet, or all up to their roots where they do not; a path with a missing frame begins with
/// the commit that makes the last one. While a frame of the path, or above it, has samples of
/// several parents, every commit counts.
/// Threads: any. Guarantee: `next` blocks, by its patience or until the watch, the buffer or the
/// store ends. It misses no commit and returns none twice.
class Watch {
public:
    ~Watch();
    Watch(const Watch&) = delete;
    Watch& operator=(const Watch&) = delete;

    /// Waits for commits after `after` that touch something, and returns those so far, in order and
    /// at most `limit` of them. Empty: none came within the timeout (none: for ever), or
    /// `Buffer::stop_waits` was called. Where the state behind a commit can be read no more, so
    /// that the path is unknown, each following commit counts, until that path can be read again.
    ///
    /// Throws InvalidArgument for a commit that does not exist yet; FeedLapped where the feed does
    /// not reach back to `after`, nor to the commit until which the watch has seen that nothing
    /// touched it; WatchClosed; Forked in a child of the process that made it; what
    /// `Buffer::wait_for_commit` throws.
    [[nodiscard]] std::vector<Touch> next(CommitNumber after,
                                          std::optional<std::int64_t> timeout_ns,
                                          std::size_t limit = ~std::size_t{0});
    /// Ends `next` in all threads.
    void close();
    [[nodiscard]] bool is_closed() const;
    /// Throws WatchClosed if it is.
    void check_open() const;

private:
    friend class Buffer;
    struct State;
    explicit Watch(std::unique_ptr<State> state);

    std::unique_ptr<State> state_;
};

}  // namespace tfdb
