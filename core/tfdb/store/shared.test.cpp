// A store that processes share: all see each commit, and no death of a process damages it.
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <memory>
#include <optional>
#include <random>
#include <string>

#include "tfdb/base/error.hpp"
#include "tfdb/store/buffer.hpp"
#include "tfdb/store/fixture.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb {
namespace {

constexpr std::size_t kMebi = std::size_t{1} << 20;

/// A test's store, which is removed at the end. Threads: one. Guarantee: none.
class NamedStore {
public:
    explicit NamedStore(std::size_t size = 64 * kMebi, std::uint32_t frames = 1000,
                        std::optional<StampNs> history = 10 * clock::kNanosPerSecond)
        : path_("/dev/shm/tfdb-test-" + std::to_string(::getpid())) {
        BufferOptions options;
        options.max_frames = frames;
        options.history_ns = history;
        ShareOptions share;
        share.size = size;
        Buffer::create(path_, share, options);
    }
    ~NamedStore() {
        if (::access(path_.c_str(), F_OK) == 0)
            Buffer::unlink(path_);
    }
    NamedStore(const NamedStore&) = delete;
    NamedStore& operator=(const NamedStore&) = delete;

    [[nodiscard]] const std::string& path() const { return path_; }
    [[nodiscard]] Buffer open(bool writable = true) const { return Buffer::open(path_, writable); }

private:
    std::string path_;
};

/// Runs `work` in a child process. Returns its exit status, or minus its signal.
template <class Work>
int in_child(Work work) {
    const pid_t child = ::fork();
    if (child == 0) {
        int status = 1;
        try {
            status = work();
        } catch (const std::exception& error) {
            std::fprintf(stderr, "child: %s\n", error.what());
        }
        ::_exit(status);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    return WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status);
}

TransformView edge(std::string_view parent, std::string_view child, StampNs stamp, double number) {
    return {parent, child, stamp, fixture::pose_of(number)};
}

/// Two joints that every commit moves together, with the same number at the same stamp.
void move_arm(Buffer& buffer, StampNs stamp, double number) {
    const std::array<TransformView, 3> batch = {edge("map", "base", stamp, number),
                                                edge("base", "shoulder", stamp, number),
                                                edge("shoulder", "hand", stamp, number)};
    buffer.set_transforms(batch, false, "arm");
}
/// Checks that all three reads of one state have the same number; returns it.
double arm_in(const StoreReader& state) {
    const auto latest = [&](const char* target, const char* source) {
        return fixture::number_of(state.lookup_latest_transform(target, source).pose);
    };
    const double base = latest("map", "base");
    CHECK_EQ(latest("base", "shoulder"), base);
    CHECK_EQ(latest("shoulder", "hand"), base);
    return base;
}

/// A frame with children cannot be removed; one without children can.
void check_children(Buffer& buffer) {
    CHECK(THROWN(FrameInUse, buffer.remove_frame("shoulder", false)));
    for (const std::string& frame : buffer.frames()) {
        if (frame.starts_with("comes"))
            buffer.remove_frame(frame, false);
    }
}

/// One of all write operations, chosen by `step`.
void do_something(Buffer& buffer, std::uint64_t step) {
    const auto stamp = static_cast<StampNs>(step) * 1'000'000 + 1'000'000'000;
    const auto number = static_cast<double>(step);
    const std::string comes = "comes" + std::to_string(step % 7);
    switch (step % 8) {
        case 1:  // late
            buffer.set_transform(edge("map", "late", stamp - 500'000'000, number), false, "late");
            break;
        case 2:  // another parent
            buffer.set_transform(edge(step % 16 == 2 ? "map" : "base", "moves", stamp, number),
                                 false, "mover");
            break;
        case 3:  // made
            buffer.set_transform(edge("hand", comes, stamp, number), false, "maker");
            break;
        case 4:  // removed
            if (const auto frames = buffer.frames();
                std::find(frames.begin(), frames.end(), comes) != frames.end())
                buffer.remove_frame(comes, false);
            break;
        case 5:  // cleared
            buffer.set_transform(edge("base", "kind", stamp, number), step % 16 == 5, "changer",
                                 {.change_kind = true, .only_new = false});
            break;
        default:
            move_arm(buffer, stamp, number);
    }
}

}  // namespace

TFDB_TEST(shared_store_is_seen_by_another_process) {
    const NamedStore store;
    Buffer here = store.open();
    here.set_transform(edge("map", "base", 100, 1.0), false, "ekf");
    here.set_transform(edge("base", "camera", 0, 2.0), true, "urdf");
    CHECK_EQ(in_child([&] {
                 Buffer there = store.open();
                 const double seen =
                     fixture::number_of(there.lookup_transform("base", "camera", 100).pose);
                 there.set_transform(edge("map", "base", 200, 3.0), false, "other");
                 return seen == 2.0 && there.frame_info("base").authority == "other" ? 0 : 2;
             }),
             0);
    CHECK_EQ(here.commit(), 3U);
    CHECK_EQ(here.frame_info("base").authority, "other");
    CHECK_EQ(here.frame_info("camera").authority, "urdf");
    here.set_transform(edge("map", "base", 300, 4.0), false, "ekf");
    CHECK_EQ(here.frame_info("base").authority, "ekf");
}

TFDB_TEST(shared_store_opened_for_reading_refuses_to_write) {
    const NamedStore store;
    Buffer writer = store.open();
    move_arm(writer, 100, 1.0);
    Buffer reader = store.open(false);
    CHECK_EQ(arm_in(reader), 1.0);
    CHECK(THROWN(ReadOnly, move_arm(reader, 200, 2.0)));
    CHECK(THROWN(ReadOnly, reader.clear()));
    CHECK(THROWN(ReadOnly, (void)reader.compact()));
    CHECK(THROWN(ReadOnly, reader.remove_frame("hand", false)));
    CHECK_EQ(reader.memory().samples, 3U);
    move_arm(writer, 200, 2.0);
    CHECK_EQ(arm_in(reader), 2.0);
}

TFDB_TEST(shared_store_keeps_what_another_process_holds) {
    const NamedStore store(64 * kMebi, 1000, 1000);
    Buffer writer = store.open();
    move_arm(writer, 1, 1.0);
    Buffer reader = store.open(false);
    const auto held = std::make_unique<Snapshot>(reader.snapshot());
    for (int i = 2; i < 5000; ++i)
        move_arm(writer, i * 100, i);
    CHECK_EQ(arm_in(*held), 1.0);
    CHECK_EQ(arm_in(reader), 4999.0);
}

TFDB_TEST(shared_store_lets_go_of_what_the_dead_held) {
    const NamedStore store(64 * kMebi, 1000, 1000);
    Buffer writer = store.open();
    move_arm(writer, 1, 1.0);
    CHECK_EQ(in_child([&] {
                 Buffer there = store.open(false);
                 const Snapshot held = there.snapshot();
                 CHECK_EQ(arm_in(held), 1.0);
                 ::raise(SIGKILL);
                 return 0;
             }),
             -SIGKILL);
    for (int i = 2; i < 20'000; ++i)
        move_arm(writer, i * 100, i);
    // Without a sweep of the dead all 60,000 samples would be kept.
    CHECK(writer.memory().samples < 6000U);
}

TFDB_TEST(shared_store_is_refused_when_it_is_none_or_damaged) {
    CHECK(THROWN(NoSuchStore, (void)Buffer::open("/dev/shm/tfdb-test-no-such", true)));
    CHECK(THROWN(NoSuchStore, Buffer::unlink("/dev/shm/tfdb-test-no-such")));
    const NamedStore store;
    CHECK(THROWN(StoreExists, Buffer::create(store.path())));
    ShareOptions small;
    small.size = kMebi;
    CHECK(THROWN(InvalidArgument, Buffer::create(store.path() + "-small", small)));
    (void)store.open();
    CHECK_EQ(::truncate(store.path().c_str(), 4096), 0);
    CHECK(THROWN(CorruptStore, (void)store.open()));
    CHECK_EQ(::truncate(store.path().c_str(), 64 * kMebi), 0);
    CHECK(THROWN(CorruptStore, (void)store.open(false)));
    CHECK(THROWN(CorruptStore, (void)Buffer::open("/dev/null", false)));
    CHECK(THROWN(CorruptStore, Buffer::unlink("/dev/shm")));
}

TFDB_TEST(shared_store_that_is_full_says_so_and_loses_nothing) {
    const NamedStore store(12 * kMebi, 1000, std::nullopt);
    Buffer buffer = store.open();
    double number = 1.0;
    const auto fill = [&] {
        for (;; number += 1.0)
            move_arm(buffer, static_cast<StampNs>(number) * 1000, number);
    };
    CHECK(THROWN(CapacityExceeded, fill()));
    CHECK(number > 10'000.0);
    CHECK_EQ(arm_in(buffer), number - 1.0);
    CHECK_EQ(arm_in(store.open(false)), number - 1.0);
}

TFDB_TEST(shared_store_survives_writers_that_are_killed) {
    const NamedStore store;
    Buffer buffer = store.open();
    move_arm(buffer, 1'000'000'000, 0.0);
    std::mt19937 random(11);
    std::uint64_t step = 1;
    std::size_t used = 0;
    const int kills = 150;
    for (int kill = 0; kill < kills; ++kill) {
        const CommitNumber before = buffer.commit();
        const pid_t child = ::fork();
        if (child == 0) {
            ::prctl(PR_SET_PDEATHSIG, SIGKILL);
            Buffer there = store.open();
            for (std::uint64_t i = step;; ++i)
                do_something(there, i);
        }
        const CommitNumber until = before + 1 + random() % 700;
        while (buffer.commit() < until)
            (void)arm_in(buffer.snapshot());
        ::kill(child, SIGKILL);
        ::waitpid(child, nullptr, 0);
        const CommitNumber committed = buffer.commit();
        const double last = arm_in(buffer);
        step = static_cast<std::uint64_t>(last) / 8 * 8 + 9;
        const StampNs stamp = buffer.frame_info("hand").newest;
        move_arm(buffer, stamp + 1, last + 1.0);
        CHECK_EQ(buffer.commit(), committed + 1);
        CHECK_EQ(arm_in(buffer), last + 1.0);
        check_children(buffer);
        if (kill == kills / 3)
            used = buffer.memory().used_bytes;
    }
    std::printf("  %llu of %d writers died at a commit\n",
                static_cast<unsigned long long>(buffer.shared()->repairs), kills);
    CHECK(buffer.shared()->repairs > 0);
    CHECK_EQ(buffer.shared()->processes, 1U);
    CHECK(buffer.memory().used_bytes < 2 * used + kMebi);
}

}  // namespace tfdb
