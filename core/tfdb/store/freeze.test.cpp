// A frozen store returns the results of its source state, and refuses writes. A damaged file is
// refused.
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <bit>
#include <cstdio>
#include <cstdlib>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "tfdb/store/fixture.hpp"
#include "tfdb/testing/sanitized.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using lookup::PolicyKind;

/// The name of a test's file, which is deleted at the end. Threads: one. Guarantee: none.
class FileName {
public:
    explicit FileName(const char* end = "")
        : path_("/tmp/tfdb-test-" + std::to_string(::getpid()) + end + ".tfdb") {}
    ~FileName() { ::unlink(path_.c_str()); }
    FileName(const FileName&) = delete;
    FileName& operator=(const FileName&) = delete;

    operator const std::string&() const { return path_; }  // NOLINT(google-explicit-constructor)

private:
    std::string path_;
};

constexpr std::array<Policy, 8> kPolicies = {{{PolicyKind::kInterpolate, lookup::kNoLimit},
                                              {PolicyKind::kInterpolate, 40},
                                              {PolicyKind::kExact, lookup::kNoLimit},
                                              {PolicyKind::kPrevious, lookup::kNoLimit},
                                              {PolicyKind::kPrevious, 25},
                                              {PolicyKind::kNearest, lookup::kNoLimit},
                                              {PolicyKind::kNearest, 12},
                                              {PolicyKind::kExtrapolate, 300}}};

/// Text that is equal only for equal bits.
std::string bits(const Pose& pose) {
    std::string text;
    const double* part = &pose.translation.x;
    for (int i = 0; i < 7; ++i)
        text += std::to_string(std::bit_cast<std::uint64_t>(part[i])) + " ";
    return text;
}
std::string shown(const FrameInfo& info) {
    return info.name + " in " + info.parent.value_or("-") + (info.is_static ? " static " : " ") +
           std::to_string(info.samples) + " " + std::to_string(info.oldest) + " " +
           std::to_string(info.newest) + " " + std::to_string(info.longest_gap) + " by " +
           info.authority + " " + std::to_string(info.late) + (info.cleared ? " cleared" : "");
}
std::string shown(const StoreReader& reads, const Answer& answer) {
    std::string text = bits(answer.pose) + "at " + std::to_string(answer.stamp) + " of " +
                       std::to_string(answer.commit);
    for (const EdgeUse& use : answer.edges) {
        text += " " + reads.frame_name(use.child, use.generation) + "<" +
                reads.frame_name(use.parent, use.parent_generation) + " " +
                std::to_string(use.before) + " " + std::to_string(use.after) + " " +
                std::to_string(static_cast<int>(use.used)) + (use.inverted ? "i" : "");
    }
    return text;
}

/// A result, or the text of its error.
template <class Ask>
void note(std::vector<std::string>& all, Ask ask) {
    try {
        all.push_back(ask());
    } catch (const Error& error) {
        all.push_back(error.what());
    }
}

/// The results of all reads of one state at these stamps.
std::vector<std::string> everything(const StoreReader& reads, const std::vector<StampNs>& stamps) {
    std::vector<std::string> all{std::to_string(reads.commit())};
    for (const FrameInfo& info : reads.tree())
        all.push_back(shown(info));
    for (const StampNs stamp : stamps) {
        for (const FrameInfo& info : reads.tree(stamp))
            all.push_back(shown(info));
    }
    const std::vector<std::string> names = reads.frames();
    for (const std::string& name : names) {
        const Samples samples = reads.samples(name);
        for (std::size_t i = 0; i < samples.poses.size(); ++i)
            all.push_back(name + std::to_string(samples.stamps[i]) + samples.parents[i] +
                          bits(samples.poses[i]));
    }
    std::vector<double> rows(7 * stamps.size());
    for (const std::string& target : names) {
        for (const std::string& source : names) {
            for (const Policy& policy : kPolicies) {
                for (const StampNs stamp : stamps)
                    note(all, [&] {
                        return shown(reads, reads.lookup_transform(target, source, stamp, policy));
                    });
                note(all, [&] {
                    reads.lookup_many(target, source, stamps, policy, Layout::kPose, Missing::kNan,
                                      rows);
                    std::string text;
                    for (const double number : rows)
                        text += std::isnan(number) ? "nan " : std::to_string(number) + " ";
                    return text;
                });
            }
            note(all, [&] { return shown(reads, reads.lookup_latest_transform(target, source)); });
            note(all, [&] {
                const CommonTimes times = reads.common_times(target, source);
                return std::to_string(times.oldest) + " " + std::to_string(times.newest);
            });
            note(all, [&] {
                const Twist twist = reads.lookup_velocity(target, source, std::nullopt, 20, "",
                                                          {1.0, 2.0, 3.0}, "");
                return std::to_string(twist.linear.x) + " " + std::to_string(twist.angular.z);
            });
            note(all, [&] {
                std::string text;
                for (const StampNs stamp :
                     reads.path_stamps(target, source, std::nullopt, std::nullopt))
                    text += std::to_string(stamp) + " ";
                return text;
            });
        }
    }
    return all;
}

void check_same(const std::vector<std::string>& frozen, const std::vector<std::string>& state) {
    CHECK_EQ(frozen.size(), state.size());
    for (std::size_t i = 0; i < std::min(frozen.size(), state.size()); ++i) {
        if (frozen[i] != state[i]) {
            testing::report_failure(__FILE__, __LINE__, frozen[i] + " instead of " + state[i]);
            return;
        }
    }
}

/// A store with late samples, repeated stamps, changed parents and kinds, and removals.
void stir(Buffer& buffer, std::mt19937& random, int steps, StampNs& now) {
    constexpr std::array<std::string_view, 7> kNames = {"map",  "odom",   "base", "arm",
                                                        "hand", "camera", "tool"};
    const auto below = [&](unsigned n) { return static_cast<unsigned>(random() % n); };
    for (int i = 0; i < steps; ++i) {
        const std::string_view child = kNames[1 + below(kNames.size() - 1)];
        const std::string_view parent = kNames[below(kNames.size())];
        const std::string authority = "node" + std::to_string(below(4));
        const unsigned event = below(100);
        now += 1 + below(9);
        try {
            if (event < 70)
                set(buffer, parent, child, now, pose_of(i), authority);
            else if (event < 82)
                set(buffer, parent, child, now - below(200), pose_of(i), "late");
            else if (event < 88)
                buffer.set_transform({parent, child, now, pose_of(i)}, below(2) == 0, authority,
                                     {.change_kind = true, .only_new = false});
            else if (event < 92)
                buffer.remove_frame(child, true);
            else if (event == 99 && below(4) == 0)
                buffer.clear();
            else
                for (int k = 0; k < 30; ++k)
                    set(buffer, "map", "odom", ++now, pose_of(k), authority);
        } catch (const Error& refused) {
            testing::count_check();
        }
    }
}

}  // namespace

TFDB_TEST(frozen_store_says_what_the_state_says) {
    const FileName file;
    for (const unsigned seed : {1U, 2U, 3U, 4U, 5U, 6U}) {
        std::mt19937 random(seed);
        Buffer buffer(keeping(seed % 2 == 0 ? std::nullopt : std::optional<StampNs>(600)));
        StampNs now = 1000;
        stir(buffer, random, 150, now);
        const Snapshot held = buffer.snapshot();
        const StampNs then = now;
        stir(buffer, random, 100, now);
        std::vector<StampNs> stamps;
        for (int i = 0; i < 9; ++i)
            stamps.push_back(then - static_cast<StampNs>(random() % 700));
        held.freeze(file);
        {
            const Buffer frozen = Buffer::open_frozen(file, true);
            std::vector<std::string> there = everything(held, stamps);
            const std::vector<std::string> here = everything(frozen, stamps);
            // Authorities and counts of late samples are those of the newest state.
            check_same(here, there);
            check_same(everything(frozen.snapshot(), stamps), here);
            CHECK(frozen.history() == buffer.history());
            CHECK_EQ(frozen.counters().normalised, buffer.counters().normalised);
        }
        buffer.freeze(file, "from a test");
        const Buffer frozen = Buffer::open_frozen(file);
        check_same(everything(frozen, {now - 20, now}), everything(buffer, {now - 20, now}));
        CHECK_EQ(frozen.frozen()->origin, "from a test");
        CHECK(!frozen.shared() && !buffer.frozen());
    }
}

TFDB_TEST(frozen_store_holds_edges_of_every_length) {
    const FileName file;
    Buffer buffer(keeping(std::nullopt));
    const std::array<StampNs, 9> lengths = {1, 2, 3, 8, 2047, 2048, 2049, 20'000, 70'000};
    for (const StampNs length : lengths) {
        std::vector<StampNs> stamps;
        std::vector<Pose> poses;
        for (StampNs i = 0; i < length; ++i) {
            stamps.push_back(10 * i);
            poses.push_back(pose_of(static_cast<double>(i)));
        }
        const std::string child = "frame" + std::to_string(length);
        const EdgeColumns columns{"map", child, stamps, poses};
        buffer.write({.columns = &columns, .authority = "columns"});
    }
    set_static(buffer, "frame8", "fixed", pose_of(1.5));
    buffer.freeze(file);
    const Buffer frozen = Buffer::open_frozen(file, true);
    for (const FrameInfo& info : buffer.tree()) {
        CHECK_EQ(shown(frozen.frame_info(info.name)), shown(info));
        for (StampNs stamp = info.oldest; stamp < info.newest; stamp += 1 + info.newest / 777) {
            const Pose there = buffer.lookup_transform("fixed", info.name, stamp % 70).pose;
            CHECK(identical(frozen.lookup_transform("fixed", info.name, stamp % 70).pose, there));
            CHECK(identical(frozen.lookup_transform("map", info.name, stamp).pose,
                            buffer.lookup_transform("map", info.name, stamp).pose));
        }
    }
    CHECK_EQ(frozen.memory().samples, buffer.memory().samples);
    // A sample takes 72 bytes; all else is negligible.
    struct stat status {};
    CHECK_EQ(::stat(std::string(file).c_str(), &status), 0);
    CHECK_EQ(frozen.frozen()->size, static_cast<std::size_t>(status.st_size));
    CHECK(static_cast<double>(status.st_size) <
          72.2 * static_cast<double>(frozen.memory().samples) + 70'000.0);
}

TFDB_TEST(frozen_store_refuses_to_be_changed) {
    const FileName file;
    Buffer buffer(defaults());
    set(buffer, "map", "base", 10, pose_of(1.0));
    set(buffer, "map", "base", 20, pose_of(2.0));
    buffer.freeze(file);
    Buffer frozen = Buffer::open_frozen(file);
    const auto error = THROWN(ReadOnly, set(frozen, "map", "base", 30, pose_of(3.0)));
    CHECK(error && says(*error, "is frozen"));
    CHECK(THROWN(ReadOnly, frozen.clear()));
    CHECK(THROWN(ReadOnly, (void)frozen.compact()));
    CHECK(THROWN(ReadOnly, frozen.remove_frame("base", false)));
    CHECK(frozen.changes(2).empty());
    const auto lapped = THROWN(FeedLapped, frozen.changes(1));
    CHECK(lapped && lapped->detail().oldest == 2 && lapped->detail().commit == 2U);
    CHECK(THROWN(InvalidArgument, frozen.changes(3)));
    CHECK_EQ(frozen.commit(), 2U);
}

TFDB_TEST(frozen_store_has_all_its_commits) {
    const FileName file;
    Buffer buffer(defaults());
    set(buffer, "map", "base", 10, pose_of(1.0));
    set(buffer, "map", "base", 20, pose_of(2.0));
    buffer.freeze(file);
    const Buffer frozen = Buffer::open_frozen(file);
    CHECK(frozen.wait_for_commit(1, std::nullopt));
    CHECK_EQ(frozen.begin_wait_for_commit(1), 0U);
    for (const CommitNumber after : {CommitNumber{2}, CommitNumber{1000}}) {
        CHECK(THROWN(NotSupported, (void)frozen.wait_for_commit(after, std::nullopt)));
        CHECK(THROWN(NotSupported, (void)frozen.begin_wait_for_commit(after)));
    }
}

TFDB_TEST(frozen_store_of_an_empty_state) {
    const FileName file;
    Buffer(defaults()).freeze(file);
    const Buffer frozen = Buffer::open_frozen(file, true);
    CHECK(frozen.frames().empty());
    CHECK_EQ(frozen.commit(), 0U);
    CHECK(THROWN(UnknownFrame, frozen.lookup_transform("map", "base")));
}

TFDB_TEST(frozen_store_may_be_replaced_while_it_is_open) {
    const FileName file;
    Buffer buffer(defaults());
    set(buffer, "map", "base", 10, pose_of(1.0));
    buffer.freeze(file);
    const Buffer before = Buffer::open_frozen(file);
    set(buffer, "map", "base", 20, pose_of(2.0));
    Buffer::open_frozen(file).freeze(file);
    buffer.freeze(file);
    CHECK_EQ(number_of(before.lookup_transform("map", "base").pose), 1.0);
    CHECK_EQ(number_of(Buffer::open_frozen(file).lookup_transform("map", "base").pose), 2.0);
}

TFDB_TEST(frozen_store_may_be_written_under_its_name) {
    const FileName file;
    const std::string& path = file;
    Buffer buffer(defaults());
    set(buffer, "map", "base", 10, pose_of(1.0));
    // The longest valid file name, so that a temporary name cannot extend it.
    const std::string longest = path.substr(0, path.rfind('/') + 1) + std::string(255, 'n');
    ::unlink(longest.c_str());
    for (const std::string& name : {path, longest}) {
        buffer.freeze(name, "", true);
        const auto error = THROWN(StoreExists, Buffer(defaults()).freeze(name, "", true));
        CHECK(error && error->detail().path == name);
        const Buffer frozen = Buffer::open_frozen(name, true);
        CHECK_EQ(number_of(frozen.lookup_transform("map", "base").pose), 1.0);
    }
    CHECK(THROWN(CapacityExceeded, buffer.freeze(longest)));
    ::unlink(longest.c_str());
    CHECK(THROWN(NoSuchStore, buffer.freeze(path + "/x.tfdb", "", true)));
}

TFDB_TEST(frozen_store_is_refused_when_it_is_none_or_damaged) {
    const FileName file;
    const std::string path = file;
    CHECK(THROWN(NoSuchStore, (void)Buffer::open_frozen(path)));
    CHECK(THROWN(NoSuchStore, (void)Buffer::open_frozen(path + "/none")));
    CHECK(THROWN(CorruptStore, (void)Buffer::open_frozen("/tmp")));
    CHECK(THROWN(CorruptStore, (void)Buffer::open_frozen("/dev/null")));
    Buffer buffer(keeping(std::nullopt));
    for (int i = 0; i < 3000; ++i)
        set(buffer, "map", "base", i, pose_of(i));
    CHECK(THROWN(NoSuchStore, buffer.freeze("/tmp/no-such-folder/x.tfdb")));
    buffer.freeze(file);
    const auto bytes = static_cast<off_t>(Buffer::open_frozen(file).frozen()->size);
    const int opened = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
    const auto flip = [&](off_t at) {
        char byte = 0;
        CHECK_EQ(::pread(opened, &byte, 1, at), 1);
        byte = static_cast<char>(byte ^ 16);
        CHECK_EQ(::pwrite(opened, &byte, 1, at), 1);
    };
    // Each byte of the first words, and some of the other bytes.
    for (off_t at = 0; at < bytes; at += at < 128 ? 1 : 4093) {
        flip(at);
        CHECK(THROWN(CorruptStore, (void)Buffer::open_frozen(file, true)));
        if (at < 16'384)
            CHECK(THROWN(CorruptStore, (void)Buffer::open_frozen(file)));
        flip(at);
    }
    (void)Buffer::open_frozen(file, true);
    for (const off_t cut : {bytes - 64, off_t{20'000}, off_t{16'384}, off_t{100}, off_t{0}}) {
        CHECK_EQ(::ftruncate(opened, cut), 0);
        CHECK(THROWN(CorruptStore, (void)Buffer::open_frozen(file)));
    }
    ::close(opened);
}

TFDB_TEST(frozen_store_that_is_damaged_ends_nobody) {
    const FileName file;
    const std::string& path = file;
    std::mt19937 random(7);
    Buffer buffer(keeping(std::nullopt));
    StampNs now = 1000;
    stir(buffer, random, 150, now);
    for (int i = 0; i < 5000; ++i)
        set(buffer, "map", "long", now + i, pose_of(i));
    buffer.freeze(file);
    const std::size_t count = Buffer::open_frozen(file).frozen()->size / 8;
    const int opened = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
    constexpr std::size_t kFront = 2048;  // words that are compared with their checksum
    for (int round = 0; round < testing::rounds(80); ++round) {
        // Most of them in names, directories and the first segments.
        const std::size_t among = round % 4 == 0 ? count - kFront : 600;
        const auto at = static_cast<off_t>(8 * (kFront + random() % among));
        std::uint64_t was = 0;
        CHECK_EQ(::pread(opened, &was, 8, at), 8);
        const std::uint64_t changed =
            round % 3 == 0 ? ~was : was ^ std::uint64_t{1} << random() % 64;
        CHECK_EQ(::pwrite(opened, &changed, 8, at), 8);
        const pid_t child = ::fork();
        if (child == 0) {
            const rlimit cpu{20, 20};
            ::setrlimit(RLIMIT_CPU, &cpu);
            try {
                const Buffer frozen = Buffer::open_frozen(file);
                (void)everything(frozen, {now, now + 2000});
            } catch (const SnapshotTooOld&) {
                ::_exit(2);  // it has no writers
            } catch (const std::exception&) {
                // The error is the expected one.
                ::_exit(1);
            }
            ::_exit(0);
        }
        int status = 0;
        ::waitpid(child, &status, 0);
        CHECK(WIFEXITED(status) && WEXITSTATUS(status) != 2);
        CHECK_EQ(::pwrite(opened, &was, 8, at), 8);
    }
    ::close(opened);
    (void)Buffer::open_frozen(file, true);
}

}  // namespace tfdb
