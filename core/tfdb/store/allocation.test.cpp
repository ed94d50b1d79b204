// Steady state asks the heap for nothing: neither commits nor lookups. The counting `new` replaces
// the program's own, and is left out under sanitizers, which bring theirs.
#include <array>
#include <atomic>
#include <cstdlib>
#include <new>

#include "tfdb/store/fixture.hpp"
#include "tfdb/store/transaction.hpp"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define TFDB_COUNTS_ALLOCATIONS 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define TFDB_COUNTS_ALLOCATIONS 0
#endif
#endif
#ifndef TFDB_COUNTS_ALLOCATIONS
#define TFDB_COUNTS_ALLOCATIONS 1
#endif

#if TFDB_COUNTS_ALLOCATIONS

namespace {
thread_local long g_allocations = 0;
thread_local long g_until_failure = -1;  // how many more succeed; negative: all
}  // namespace

// None of them inlined: the compiler would take `malloc` and `delete`, say, for a mismatch.
[[gnu::noinline]] void* operator new(std::size_t bytes) {
    ++g_allocations;
    if (g_until_failure >= 0 && g_until_failure-- == 0)
        throw std::bad_alloc();
    if (void* block = std::malloc(bytes == 0 ? 1 : bytes))
        return block;
    throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* block) noexcept {
    std::free(block);
}
[[gnu::noinline]] void operator delete(void* block, std::size_t) noexcept {
    std::free(block);
}

namespace tfdb {
namespace {

using namespace fixture;

constexpr int kWarm = 5000;
constexpr int kCounted = 20'000;

/// How often `call(i)` allocates in all, after it has been called for a while.
template <class Call>
long counted(Call&& call) {
    for (int i = 0; i < kWarm; ++i)
        call(i);
    const long before = g_allocations;
    for (int i = kWarm; i < kWarm + kCounted; ++i)
        call(i);
    return g_allocations - before;
}

const std::array<std::string, 11> kNames = {"world", "j0", "j1", "j2", "j3", "j4",
                                            "j5",    "j6", "j7", "j8", "j9"};

std::array<TransformView, 10> joints(StampNs stamp) {
    std::array<TransformView, 10> batch;
    for (std::size_t i = 0; i < batch.size(); ++i)
        batch[i] = {kNames[i], kNames[i + 1], stamp, pose_of(static_cast<double>(i))};
    return batch;
}

Buffer robot() {
    Buffer buffer(keeping(200));
    for (StampNs stamp = 0; stamp < 1000; ++stamp)
        buffer.set_transforms(joints(stamp), false, "joints");
    return buffer;
}

}  // namespace

TFDB_TEST(allocation_is_counted_at_all) {
    CHECK_EQ(counted([](int) { ::operator delete(::operator new(8)); }), kCounted);
}

TFDB_TEST(allocation_none_in_set_transform_of_one_edge) {
    Buffer buffer(keeping(200));
    CHECK_EQ(counted([&](int i) { set(buffer, "map", "base", i, pose_of(1), "ekf"); }), 0);
    // A correction and a late sample neither.
    CHECK_EQ(counted([&](int i) {
                 const StampNs stamp = kWarm + kCounted + i;
                 set(buffer, "map", "base", stamp - (i % 5 == 0 ? 3 : 0), pose_of(1), "ekf");
             }),
             0);
}

TFDB_TEST(allocation_none_in_set_transforms_of_ten_edges) {
    Buffer buffer = robot();
    CHECK_EQ(counted([&](int i) { buffer.set_transforms(joints(1000 + i), false, "joints"); }), 0);
}

TFDB_TEST(allocation_none_in_static_revisions) {
    Buffer buffer(defaults());
    CHECK_EQ(counted([&](int i) { set_static(buffer, "base", "eye", pose_of(i)); }), 0);
}

TFDB_TEST(allocation_none_in_lookups) {
    const Buffer buffer = robot();
    FrameHandle world;
    FrameHandle tip;
    CHECK(buffer.find_frame("world", world) && buffer.find_frame("j9", tip));
    Answer answer;
    Failure failure;
    Question full = store::by_way_of("world", "j9", 900, "j9", {}, {});
    long answered = 0;
    CHECK_EQ(counted([&](int i) {
                 answered += buffer.try_lookup(world, tip, 800 + i % 199, {}, answer, failure);
                 answered += buffer.try_lookup(tip, world, std::nullopt, {}, answer, failure);
                 answered += buffer.try_lookup_latest(world, tip, {}, 0, answer, failure);
                 answered += buffer.ask(full, answer, failure);
                 answered += buffer.find_frame("j5", tip) && buffer.find_frame("j9", tip);
             }),
             0);
    CHECK_EQ(answered, 5L * (kWarm + kCounted));
}

TFDB_TEST(allocation_none_in_lookups_that_fail) {
    Buffer buffer = robot();
    set_static(buffer, "space", "moon", pose_of(1));
    FrameHandle world;
    FrameHandle tip;
    FrameHandle moon;
    CHECK(buffer.find_frame("world", world) && buffer.find_frame("j9", tip));
    CHECK(buffer.find_frame("moon", moon));
    Answer answer;
    Failure failure;
    long answered = 0;
    CHECK_EQ(counted([&](int i) {
                 answered += buffer.try_lookup(world, tip, 5000 + i, {}, answer, failure);
                 answered += buffer.try_lookup(moon, tip, 900, {}, answer, failure);
                 answered += buffer.try_lookup(world, {}, 900, {}, answer, failure);
             }),
             0);
    CHECK_EQ(answered, 0);
}

namespace {

void write_partly(Buffer& buffer) {
    const TransformView batch[] = {{"map", "new", 50, pose_of(3)}, {"map", "", 50, pose_of(4)}};
    CommitNumber commit = 0;
    (void)buffer.set_transforms_partial(batch, false, "somebody", commit);
}
void write_in_transaction(Buffer& buffer) {
    const TransformView batch[] = {{"map", "a", 50, pose_of(3)}, {"a", "b", 50, pose_of(4)}};
    Transaction tx(buffer);
    (void)tx.lookup_transform("map", "b");
    tx.set_transforms(batch, false, "somebody");
    tx.commit();
}
void write_plainly(Buffer& buffer) {
    const TransformView batch[] = {{"map", "a", 50, pose_of(3)}, {"a", "b", 50, pose_of(4)}};
    buffer.set_transforms(batch, false, "somebody");
}

/// Samples of everything: a commit that was refused may draw a number.
std::size_t stored(const Buffer& buffer) {
    return buffer.memory().samples + buffer.frames().size();
}

/// Calls `write` on a store of its own whose n-th allocation fails; false if it needs fewer.
bool fails_cleanly(Concurrency concurrency, void (*write)(Buffer&), long n) {
    BufferOptions options = keeping(std::nullopt);
    options.concurrency = concurrency;
    Buffer buffer(options);
    set(buffer, "map", "a", 10, pose_of(1));
    set(buffer, "a", "b", 10, pose_of(2));
    const std::size_t before = stored(buffer);
    bool failed = false;
    g_until_failure = n;
    try {
        write(buffer);
    } catch (const std::bad_alloc&) {
        failed = true;
    }
    g_until_failure = -1;
    if (failed)
        CHECK_EQ(stored(buffer), before);
    // Nobody holds a lock any more.
    write_plainly(buffer);
    write_in_transaction(buffer);
    CHECK_EQ(number_of(buffer.lookup_transform("map", "a", 50).pose), 3.0);
    return failed;
}

}  // namespace

TFDB_TEST(allocation_that_fails_stores_nothing_and_keeps_no_lock) {
    for (std::size_t i = 0; i < kConcurrencies; ++i) {
        for (const auto write : {write_partly, write_in_transaction, write_plainly}) {
            long n = 0;
            while (fails_cleanly(static_cast<Concurrency>(i), write, n))
                ++n;
            CHECK(n > 3);
        }
    }
}

}  // namespace tfdb

#endif
