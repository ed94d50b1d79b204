// Watches: they return the commits that touched some frames or paths.
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

/// The subjects of a watch: frame names, and pairs (target, source) for their path. Any frame may
/// be missing at first.
struct Watched {
    std::vector<std::string> frames;
    std::vector<std::pair<std::string, std::string>> pairs;
    bool every_commit = false;
};

/// A commit and the subjects that it touched.
struct Touch {
    CommitNumber commit = 0;
    // Indices into `Watched`, ascending: frames, then pairs, then every commit.
    std::vector<std::uint32_t> what;
};

/// Frames and paths whose commits a follower needs. A commit touches a frame if it stores samples
/// of it, moves, clears, creates or removes it. A commit touches a pair if it touches a frame of
/// the pair's path. The newest parents before or after the commit determine the path: the frames
/// below the meeting point of target and source, or all frames up to both roots. A path with
/// missing frames begins with the commit that creates the last of them. While a frame of the path
/// or above it has samples of several parents, every commit counts.
/// Threads: any. Guarantee: `next` blocks, until its timeout or until the watch, the buffer or the
/// store ends. It misses no commit and returns none twice.
class Watch {
public:
    ~Watch();
    Watch(const Watch&) = delete;
    Watch& operator=(const Watch&) = delete;

    /// Waits for commits after `after` that touch a subject, and returns those so far, in order, at
    /// most `limit` of them. Empty: none came within the timeout (none: unlimited), or
    /// `Buffer::stop_waits` was called. If the state after a commit can no longer be read, the path
    /// is unknown; every following commit then counts until the path can be read again.
    ///
    /// Throws InvalidArgument for a future commit. Throws FeedLapped if the feed begins after
    /// `after` and after the last commit up to which the watch saw its subjects untouched. Throws
    /// WatchClosed; Forked in a child of the process that created it; and the exceptions of
    /// `Buffer::wait_for_commit`.
    [[nodiscard]] std::vector<Touch> next(CommitNumber after,
                                          std::optional<std::int64_t> timeout_ns,
                                          std::size_t limit = ~std::size_t{0});
    /// Ends `next` in all threads.
    void close();
    [[nodiscard]] bool is_closed() const;
    /// Throws WatchClosed if the watch is closed.
    void check_open() const;

private:
    friend class Buffer;
    struct State;
    explicit Watch(std::unique_ptr<State> state);

    std::unique_ptr<State> state_;
};

}  // namespace tfdb
