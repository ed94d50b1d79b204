// Watches: each commit that touches their frames, once and in order; few others.
#include "tfdb/store/watch.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <random>
#include <set>
#include <thread>

#include "tfdb/base/interruption.hpp"
#include "tfdb/store/transaction_fixture.test.hpp"
#include "tfdb/testing/sanitized.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using Names = std::set<std::string>;
using What = std::vector<std::uint32_t>;

constexpr std::int64_t kLong = 60 * kSecond;

/// True, for the test to end there, in engines that keep no feed, or have no waits.
bool skipped() {
    return skipped_in({Concurrency::kGiant, Concurrency::kFine, Concurrency::kNoWait,
                       Concurrency::kWaitDie, Concurrency::kWoundWait, Concurrency::kSilo},
                      "watches are not supported there");
}

void put(Buffer& buffer, std::string_view parent, std::string_view child, StampNs stamp) {
    set(buffer, parent, child, stamp, pose_of(static_cast<double>(stamp % 90)));
}

/// Touches of commits after `after`, without waiting.
std::map<CommitNumber, What> touched(Watch& watch, CommitNumber after) {
    std::map<CommitNumber, What> found;
    for (const Touch& touch : watch.next(after, 0)) {
        CHECK(touch.commit > after && (found.empty() || found.rbegin()->first < touch.commit));
        CHECK(!touch.what.empty() && std::is_sorted(touch.what.begin(), touch.what.end()));
        found[touch.commit] = touch.what;
    }
    return found;
}

/// Random commits. Threads: one. Guarantee: the same seed does the same.
class Author {
public:
    /// `orderly`: no batch is refused. A refused one may leave the flag of several parents.
    explicit Author(unsigned seed, bool orderly) : orderly_(orderly), random_(seed) {}

    void act(Buffer& buffer) {
        now_ += 2;
        try {
            switch (below(30)) {
                case 0:
                    buffer.clear();
                    break;
                case 1:
                case 2:
                    buffer.remove_frame(name(), below(2) == 0);
                    break;
                case 3:
                    write(buffer, true);
                    break;
                case 4:
                    transact(buffer);
                    break;
                default:
                    write(buffer, false);
            }
        } catch (const Error&) {
            testing::count_check();  // refused: nothing was changed
        }
    }
    [[nodiscard]] StampNs now() const { return now_; }
    std::string name() { return name_before(kNames); }
    unsigned below(unsigned limit) { return static_cast<unsigned>(random_()) % limit; }

private:
    static constexpr unsigned kNames = 8;

    std::string name_before(unsigned place) {
        return std::string(1, static_cast<char>('a' + below(place)));
    }
    /// Mostly a fixed forest.
    std::string parent_of(const std::string& child) {
        const auto place = static_cast<unsigned>(child[0] - 'a');
        if (place > 0 && below(12) != 0)
            return std::string(1, static_cast<char>('a' + (place - 1) / 2));
        return orderly_ ? (place == 0 ? "root" : name_before(place)) : name();
    }
    void write(Buffer& buffer, bool is_static) {
        std::vector<std::pair<std::string, std::string>> edges(1 + below(3));
        std::vector<TransformView> batch;
        const std::size_t first = below(kNames);
        for (auto& [parent, child] : edges) {
            // Each once: a parent without remaining samples is not in the feed.
            child = std::string(1, static_cast<char>('a' + (first + batch.size()) % kNames));
            parent = parent_of(child);
            const StampNs late = below(6) == 0 ? below(40) : 0;
            batch.push_back({parent, child, now_ - late, pose_of(static_cast<double>(below(80)))});
        }
        buffer.set_transforms(batch, is_static, "", {.change_kind = below(4) == 0 || orderly_});
    }
    /// A frame is removed and made in one commit, or made and removed.
    void transact(Buffer& buffer) {
        Transaction tx(buffer);
        const std::string victim = name();
        if (has_frame(buffer.snapshot(), victim))
            tx.remove_frame(victim, true);
        if (below(2) == 0)
            fixture::put(tx, parent_of(victim), victim, now_, 1);
        fixture::put(tx, name(), "passing", now_, 2);
        tx.remove_frame("passing", false);
        tx.commit();
    }

    bool orderly_;
    std::mt19937 random_;
    StampNs now_ = 1000;
};

/// The frames whose edges are the path of a pair in a state, by the public reads.
struct Path {
    Names frames;
    bool circles = false;

    Path(const StoreReader& reads, const std::string& target, const std::string& source) {
        if (!has_frame(reads, target) || !has_frame(reads, source))
            return;
        const std::vector<std::string> down = chain(reads, target);
        const std::vector<std::string> up = chain(reads, source);
        const auto meets = [&](const std::string& name) {
            return std::find(up.begin(), up.end(), name) != up.end();
        };
        const auto top = std::find_if(down.begin(), down.end(), meets);
        frames.insert(down.begin(), top);
        frames.insert(up.begin(),
                      top == down.end() ? up.end() : std::find(up.begin(), up.end(), *top));
        if (frames.empty())
            frames.insert(target);
    }

private:
    std::vector<std::string> chain(const StoreReader& reads, std::string name) {
        std::vector<std::string> found;
        for (;;) {
            found.push_back(name);
            const std::optional<std::string> parent = reads.parent_of(name);
            if (!parent)
                return found;
            if (std::find(found.begin(), found.end(), *parent) != found.end()) {
                circles = true;
                return found;
            }
            name = *parent;
        }
    }
};

/// The touches that must be reported for each commit, and those that may be.
/// Threads: one. Guarantee: of a store with one writer.
class Oracle {
public:
    explicit Oracle(const Watched& watched) : watched_(watched) {}

    /// Adds the next commit, whose state `reads` reads.
    void add(const StoreReader& reads, const Changes& changes) {
        Names names;
        for (const auto* list : {&changes.made, &changes.moved, &changes.cleared, &changes.removed})
            names.insert(list->begin(), list->end());
        for (const auto& edge : changes.stored)
            names.insert(edge.child);
        for (const auto* list : {&changes.removed, &changes.cleared}) {
            for (const std::string& name : *list)
                parents_.erase(name);
        }
        for (const auto& edge : changes.stored)
            parents_[edge.child].insert(edge.parents.begin(), edge.parents.end());
        What must;
        What may;
        for (std::uint32_t i = 0; i < watched_.frames.size(); ++i) {
            if (names.count(watched_.frames[i]) != 0)
                must.push_back(i);
        }
        may = must;
        for (std::uint32_t i = 0; i < watched_.pairs.size(); ++i) {
            const auto& [target, source] = watched_.pairs[i];
            const Path path(reads, target, source);
            const bool mixed = path.circles || any_mixed(path.frames);
            const auto place = static_cast<std::uint32_t>(i + watched_.frames.size());
            const bool touches = meet(names, path.frames) || meet(names, before_[i]);
            if (touches)
                must.push_back(place);
            if (touches || mixed || mixed_before_[i])
                may.push_back(place);
            before_[i] = path.frames;
            mixed_before_[i] = mixed;
        }
        must_[changes.commit] = must;
        may_[changes.commit] = may;
    }

    /// `found`: of the commits from `first` on.
    [[nodiscard]] bool agrees(const std::map<CommitNumber, What>& found, CommitNumber first,
                              bool exact) const {
        for (auto at = must_.lower_bound(first); at != must_.end(); ++at) {
            const auto it = found.find(at->first);
            const What told = it == found.end() ? What{} : it->second;
            const What& may = may_.at(at->first);
            if (!std::includes(told.begin(), told.end(), at->second.begin(), at->second.end()) ||
                (exact && !std::includes(may.begin(), may.end(), told.begin(), told.end()))) {
                std::printf("  commit %llu: told %s, must %s, may %s\n",
                            static_cast<unsigned long long>(at->first), text(told).c_str(),
                            text(at->second).c_str(), text(may).c_str());
                return false;
            }
        }
        return found.empty() || found.rbegin()->first <= must_.rbegin()->first;
    }
    [[nodiscard]] std::size_t touches() const {
        std::size_t count = 0;
        for (const auto& [commit, what] : must_)
            count += what.size();
        return count;
    }

private:
    static bool meet(const Names& a, const Names& b) {
        return std::any_of(a.begin(), a.end(),
                           [&](const auto& name) { return b.count(name) != 0; });
    }
    static std::string text(const What& what) {
        std::string all = "[";
        for (const std::uint32_t place : what)
            all += " " + std::to_string(place);
        return all + " ]";
    }
    [[nodiscard]] bool any_mixed(const Names& names) const {
        return std::any_of(names.begin(), names.end(), [this](const std::string& name) {
            const auto found = parents_.find(name);
            return found != parents_.end() && found->second.size() > 1;
        });
    }

    Watched watched_;
    std::map<std::string, Names> parents_;  // that samples of a frame named
    std::map<std::size_t, Names> before_;
    std::map<std::size_t, bool> mixed_before_;
    std::map<CommitNumber, What> must_;
    std::map<CommitNumber, What> may_;
};

/// The results of a state for each subject, bit for bit.
std::vector<std::string> answers(const StoreReader& reads, const Watched& watched, StampNs now) {
    std::vector<std::string> all;
    const auto add = [&](const std::function<std::string()>& ask) {
        try {
            all.back() += ask();
        } catch (const Error& error) {
            all.back() += std::to_string(static_cast<int>(error.code())) + ";";
        }
    };
    const auto text_of = [](const Answer& answer) {
        std::string text(reinterpret_cast<const char*>(&answer.pose), sizeof answer.pose);
        return text + std::to_string(answer.stamp) + ";";
    };
    for (const std::string& name : watched.frames) {
        all.emplace_back();
        add([&] {
            const FrameInfo info = reads.frame_info(name);
            return info.parent.value_or("") + "," + std::to_string(info.samples) + "," +
                   std::to_string(info.oldest) + "," + std::to_string(info.newest);
        });
    }
    for (const auto& pair : watched.pairs) {
        const std::string& target = pair.first;
        const std::string& source = pair.second;
        all.emplace_back();
        add([&] { return text_of(reads.lookup_latest_transform(target, source)); });
        add([&] { return text_of(reads.lookup_transform(target, source)); });
        for (const StampNs age : {0, 1, 7, 20, 45})
            add([&] { return text_of(reads.lookup_transform(target, source, now - age)); });
    }
    return all;
}

const Watched kAll{{"a", "d", "h"},
                   {{"a", "h"}, {"d", "e"}, {"b", "b"}, {"c", "nowhere"}, {"h", "g"}, {"g", "h"}}};

}  // namespace

TFDB_TEST(a_watch_tells_which_commits_touched_what) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    const auto watch = buffer.watch({{"arm", "world"}, {{"map", "hand"}, {"base", "hand"}}});
    const Snapshot held = buffer.snapshot();
    put(buffer, "map", "base", 1);    // 1
    put(buffer, "base", "arm", 1);    // 2: arm is made
    put(buffer, "arm", "hand", 1);    // 3: hand is made: both pairs begin
    put(buffer, "map", "base", 2);    // 4: above where base and hand meet
    put(buffer, "base", "other", 2);  // 5: beside the paths
    put(buffer, "world", "map", 2);   // 6: world is made, the path ends below map
    CHECK(touched(*watch, 0) ==
          (std::map<CommitNumber, What>{{2, {0}}, {3, {2, 3}}, {4, {2}}, {6, {1}}}));
    buffer.remove_frame("hand", false);  // 7
    put(buffer, "base", "hand", 3);      // 8: another path
    put(buffer, "base", "arm", 3);       // 9: no longer of it
    CHECK(touched(*watch, 6) == (std::map<CommitNumber, What>{{7, {2, 3}}, {8, {2, 3}}, {9, {0}}}));
    // Repeated calls return the same.
    CHECK_EQ(touched(*watch, 2).size(), std::size_t{6});
    CHECK(touched(*watch, 9).empty());
    const auto error = THROWN(InvalidArgument, watch->next(10, 0));
    CHECK(error && says(*error, "no commit 10 yet: the newest is 9"));
}

TFDB_TEST(a_watch_counts_every_commit_of_a_path_with_several_parents) {
    if (skipped())
        return;
    Buffer buffer(keeping(100));
    put(buffer, "map", "table", 1);
    put(buffer, "map", "hand", 1);
    put(buffer, "table", "cup", 1);
    const auto watch = buffer.watch({{}, {{"map", "cup"}}});
    put(buffer, "map", "hand", 2);
    CHECK(touched(*watch, 3).empty());
    put(buffer, "hand", "cup", 3);   // 5
    put(buffer, "map", "other", 3);  // 6: the cup was on the table at older stamps
    CHECK(touched(*watch, 3) == (std::map<CommitNumber, What>{{5, {0}}, {6, {0}}}));
    // Not for its descendants: both chains meet below it.
    const auto inside = buffer.watch({{}, {{"cup", "handle"}}});
    put(buffer, "cup", "handle", 3);  // 7
    put(buffer, "map", "other", 4);   // 8
    CHECK(touched(*inside, 6) == (std::map<CommitNumber, What>{{7, {0}}}));
    buffer.clear();
    put(buffer, "hand", "cup", 300);   // 10
    put(buffer, "map", "other", 300);  // 11: no more
    CHECK(touched(*watch, 8) == (std::map<CommitNumber, What>{{9, {0}}, {10, {0}}}));
}

TFDB_TEST(a_watch_agrees_with_changes_and_the_state_of_each_commit) {
    if (skipped())
        return;
    constexpr unsigned kSeeds = testing::rounds(30);
    constexpr int kCommits = 300;
    std::printf("  seeds 1..%u\n", kSeeds);
    std::size_t touches = 0;
    std::size_t same = 0;
    for (unsigned seed = 1; seed <= kSeeds; ++seed) {
        Buffer buffer(keeping(60));
        Author author(seed, true);
        Oracle oracle(kAll);
        const auto eager = buffer.watch(kAll);  // asked after each commit
        const auto lazy = buffer.watch(kAll);   // sometimes, and from further back
        const Snapshot held = buffer.snapshot();
        std::map<CommitNumber, What> found;
        CommitNumber seen = 0;
        for (int i = 0; i < kCommits; ++i) {
            author.act(buffer);
            for (const Changes& changes : buffer.changes(seen)) {
                seen = changes.commit;
                oracle.add(held.at(seen), changes);
                found.merge(touched(*eager, seen - 1));
                CHECK(oracle.agrees(found, seen, true));
                const auto was = answers(held.at(seen - 1), kAll, author.now());
                const auto is = answers(held.at(seen), kAll, author.now());
                for (std::uint32_t place = 0; place < is.size(); ++place) {
                    const What& what = found[seen];
                    const bool told = std::find(what.begin(), what.end(), place) != what.end();
                    CHECK(told || was[place] == is[place]);
                    same += told ? 0 : 1;
                }
            }
            if (author.below(8) == 0) {
                const CommitNumber after = author.below(static_cast<unsigned>(seen) + 1);
                CHECK(oracle.agrees(touched(*lazy, after), after + 1, false));
            }
        }
        CHECK(oracle.agrees(found, 1, true));
        // A watch that begins late returns the same.
        CHECK(oracle.agrees(touched(*buffer.watch(kAll), 0), 1, false));
        touches += oracle.touches();
    }
    CHECK(touches > testing::rounds(10'000));
    CHECK(same > testing::rounds(10'000));
}

/// Three threads follow, two of them with one watch; no state is held. The writer notes the effect
/// of each commit.
TFDB_TEST(a_watch_beside_a_writer_misses_nothing) {
    if (skipped())
        return;
    constexpr int kCommits = 8'000;  // the feed holds them all
    for (const unsigned seed : {1U, 2U, 3U}) {
        std::printf("  seed %u\n", seed);
        Buffer buffer(keeping(60));
        Oracle oracle(kAll);
        const auto first = buffer.watch(kAll);
        const auto second = buffer.watch(kAll);
        std::atomic<CommitNumber> last{kMaxCommit};
        std::vector<std::map<CommitNumber, What>> found(3);
        std::vector<std::thread> threads;
        for (unsigned t = 0; t < found.size(); ++t) {
            threads.emplace_back([&, t] {
                std::minstd_rand random(seed * 10 + t);
                Watch& watch = t == 0 ? *first : *second;
                CommitNumber seen = 0;
                while (seen < last.load()) {
                    const auto most =
                        random() % 3 == 0 ? kLong : static_cast<std::int64_t>(random() % 2'000'000);
                    const CommitNumber newest = buffer.commit();
                    const auto all = watch.next(seen, most);
                    for (const Touch& touch : all) {
                        CHECK(touch.commit > seen);
                        seen = touch.commit;
                        found[t][seen] = touch.what;
                    }
                    if (all.empty())
                        seen = std::max(seen, newest);
                }
            });
        }
        Author author(seed, false);
        for (int i = 0; i < kCommits; ++i) {
            const CommitNumber before = buffer.commit();
            author.act(buffer);
            if (buffer.commit() == before)
                continue;
            oracle.add(buffer, buffer.changes(before).at(0));
        }
        last = buffer.commit() + 1;
        put(buffer, "z", "a", 1'000'000);  // wakes those that wait
        oracle.add(buffer, buffer.changes(last - 1).at(0));
        for (std::thread& thread : threads)
            thread.join();
        for (const auto& told : found)
            CHECK(oracle.agrees(told, 1, false));
    }
}

/// One follower sleeps. Another one reads from an earlier commit, when the path was different, and
/// ends.
TFDB_TEST(a_watch_wakes_the_follower_that_sleeps_beside_one_that_is_behind) {
    if (skipped())
        return;
    for (int round = 0; round < 50; ++round) {
        Buffer buffer(keeping(std::nullopt));
        const Snapshot held = buffer.snapshot();
        put(buffer, "map", "table", 1);
        put(buffer, "map", "hand", 1);
        put(buffer, "hand", "cup", 1);  // 3
        buffer.remove_frame("cup", false);
        put(buffer, "table", "cup", 2);  // 5
        const auto watch = buffer.watch({{}, {{"map", "cup"}}});
        CHECK(watch->next(5, 0).empty());
        std::vector<Touch> found;
        std::thread sleeping([&] { found = watch->next(5, kLong); });
        std::this_thread::yield();
        CHECK_EQ(touched(*watch, 3).size(), std::size_t{2});
        put(buffer, "map", "table", 3);  // 6
        sleeping.join();
        CHECK(found.size() == 1 && found[0].commit == 6);
    }
}

TFDB_TEST(a_watch_sleeps_until_it_is_touched) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    const auto watch = buffer.watch({{"a"}, {}});
    std::vector<Touch> found;
    std::thread waiting([&] { found = watch->next(0, kLong); });
    for (StampNs stamp = 1; stamp <= 500; ++stamp)
        put(buffer, "map", "other", stamp);
    put(buffer, "map", "a", 1);
    waiting.join();
    CHECK(found.size() == 1 && found[0].commit == 501 && found[0].what == What{0});
    CHECK(watch->next(501, 1'000'000).empty());
}

/// The feed overruns a watch that was never read, but not one whose reads were empty.
TFDB_TEST(a_quiet_watch_is_not_lapped) {
    if (skipped())
        return;
    Buffer buffer(keeping(100));
    put(buffer, "map", "a", 1);
    const auto watch = buffer.watch({{"a"}, {{"map", "a"}}});
    const auto idle = buffer.watch({{"a"}, {}});
    StampNs stamp = 1;
    for (int round = 0; round < 20; ++round) {
        for (int i = 0; i < 1'000; ++i)
            put(buffer, "map", "busy", ++stamp);
        CHECK(watch->next(1, 0).empty());
    }
    const auto lapped = THROWN(FeedLapped, idle->next(1, 0));
    CHECK(lapped && lapped->detail().since == 1U);
    CHECK_THROWS_AS(idle->next(2, 0), FeedLapped);
    // Unread commits do not count as commits without touches.
    CHECK_THROWS_AS(idle->next(1, 0), FeedLapped);
    CHECK(idle->next(lapped->detail().commit.value(), 0).empty());
    put(buffer, "map", "a", 2);
    CHECK_EQ(touched(*watch, 1).size(), std::size_t{1});
    CHECK_EQ(touched(*idle, 15'000).size(), std::size_t{1});
}

/// The listening thread of another wait checks repeatedly; then a commit touches the watch.
TFDB_TEST(a_watch_that_slept_long_is_not_lapped) {
    if (skipped())
        return;
    Buffer buffer(keeping(100));
    put(buffer, "map", "a", 1);
    const auto watch = buffer.watch({{"a"}, {}});
    StampNs stamp = 1;
    const auto others = [&] {
        for (int round = 0; round < 20; ++round) {
            for (int i = 0; i < 1'000; ++i)
                put(buffer, "map", "busy", ++stamp);
            (void)buffer.ended_waits(0);
        }
    };
    CHECK(watch->next(1, 0).empty());
    others();
    put(buffer, "map", "a", 2);
    (void)buffer.ended_waits(0);
    CHECK(touched(*watch, 1) == (std::map<CommitNumber, What>{{20'002, {0}}}));
    // A caller that reads from an earlier commit gets all commits, or the feed has overrun it.
    CHECK_EQ(touched(*watch, 20'001).size(), std::size_t{1});
    others();
    CHECK_THROWS_AS(watch->next(20'001, 0), FeedLapped);
    CHECK(watch->next(40'002, 0).empty());
}

/// Two followers of one watch, one of them at an earlier commit.
TFDB_TEST(a_watch_returns_all_to_each_follower) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    const auto watch = buffer.watch({{"a"}, {}});
    std::map<CommitNumber, What> first;
    std::map<CommitNumber, What> second;
    CommitNumber behind = 0;
    for (StampNs stamp = 1; stamp <= 300; ++stamp) {
        put(buffer, "map", stamp % 3 == 0 ? "a" : "other", stamp);
        first.merge(touched(*watch, static_cast<CommitNumber>(stamp) - 1));
        if (stamp % 7 != 0)
            continue;
        second.merge(touched(*watch, behind));
        behind = second.empty() ? 0 : second.rbegin()->first;
    }
    CHECK_EQ(first.size(), std::size_t{100});
    second.merge(touched(*watch, behind));
    CHECK(first == second);
    for (const std::size_t limit : {1, 7, 64}) {
        std::map<CommitNumber, What> pages;
        for (bool more = true; more;) {
            const CommitNumber last = pages.empty() ? 0 : pages.rbegin()->first;
            const std::vector<Touch> page = watch->next(last, 0, limit);
            CHECK(page.size() <= limit);
            more = page.size() == limit;
            for (const Touch& touch : page)
                pages[touch.commit] = touch.what;
        }
        CHECK(first == pages);
    }
}

TFDB_TEST(a_watch_ends_with_what_it_is_of) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    const auto ends = [&](const std::shared_ptr<Watch>& watch, const std::function<void()>& end,
                          ErrorCode expected) {
        std::optional<ErrorCode> code;
        std::thread waiting([&] {
            try {
                (void)watch->next(0, std::nullopt);
            } catch (const Error& error) {
                code = error.code();
            }
        });
        end();
        waiting.join();
        CHECK(code == expected);
    };
    const auto watch = buffer.watch({{"a"}, {}});
    ends(
        watch, [&] { watch->close(); }, ErrorCode::kWatchClosed);
    watch->close();
    CHECK_THROWS_AS(watch->next(0, 0), WatchClosed);
    const auto stopped = buffer.watch({{"a"}, {}});
    std::thread waiting([&] { CHECK(stopped->next(0, std::nullopt).empty()); });
    buffer.stop_waits(true);
    waiting.join();
    CHECK(stopped->next(0, kLong).empty());
    buffer.stop_waits(false);
    put(buffer, "map", "a", 1);
    CHECK_EQ(stopped->next(0, kLong).size(), std::size_t{1});
    ends(
        buffer.watch({{"b"}, {}}), [&] { buffer.end_waits(); }, ErrorCode::kBufferClosed);
    CHECK_EQ(stopped->next(0, kLong).size(), std::size_t{1});
}

TFDB_TEST(a_watch_is_interrupted_and_goes_on) {
    if (skipped())
        return;
    // NOLINTNEXTLINE(cppcoreguidelines-virtual-class-destructor): on the stack only
    struct Ends final : Interruption {
        void ask() override {
            (void)watch->next(0, 0);  // a handler may use the same watch
            throw std::runtime_error("a signal");
        }
        Watch* watch = nullptr;
    };
    Buffer buffer(keeping(std::nullopt));
    const auto watch = buffer.watch({{"a"}, {}});
    std::thread other([&] { CHECK_EQ(watch->next(0, kLong).size(), std::size_t{1}); });
    std::thread interrupted([&] {
        Ends ends;
        ends.watch = watch.get();
        Interruption::current() = &ends;
        CHECK_THROWS_AS(watch->next(0, kLong), std::runtime_error);
        Interruption::current() = nullptr;
    });
    interrupted.join();
    put(buffer, "map", "a", 1);
    other.join();
    CHECK_EQ(touched(*watch, 0).size(), std::size_t{1});
}

TFDB_TEST(a_watch_is_asked_for_with_sense) {
    const Watched one{{"a"}, {}};
    if (engine() != Concurrency::kSnapshot) {
        Buffer buffer(defaults());
        CHECK_THROWS_AS(buffer.watch(one), NotSupported);
        return;
    }
    Buffer buffer(defaults());
    CHECK_THROWS_AS(buffer.watch({}), InvalidArgument);
    const auto error = THROWN(InvalidName, buffer.watch({{}, {{"map", ""}}}));
    CHECK(error && says(*error, "the source frame name '' is empty"));
    const auto watch = buffer.watch(one);
    Transaction tx(buffer);
    CHECK_THROWS_AS(watch->next(0, 0), TransactionActive);
    CHECK_THROWS_AS(buffer.watch(one), TransactionActive);
}

TFDB_TEST(a_child_makes_a_watch_of_its_own) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    const auto watch = buffer.watch({{"a"}, {}});
    std::thread waiting([&] { CHECK_EQ(watch->next(0, kLong).size(), std::size_t{1}); });
    const pid_t child = ::fork();
    if (child == 0) {
        bool refused = false;
        try {
            (void)watch->next(0, 0);
        } catch (const Forked&) {
            refused = true;
        }
        watch->close();
        const bool quiet = buffer.watch({{"a"}, {}})->next(buffer.commit(), 1'000'000).empty();
        ::_exit(refused && quiet ? 0 : 1);
    }
    int status = 0;
    CHECK(::waitpid(child, &status, 0) == child);
    CHECK_EQ(status, 0);
    put(buffer, "map", "a", 1);
    waiting.join();
}

}  // namespace tfdb
