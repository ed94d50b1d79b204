// In steady state neither commits nor lookups allocate from the heap.
#include "tfdb/store/allocation.test.hpp"

#include <array>
#include <cstdlib>
#include <new>

#include "tfdb/store/fixture.hpp"

#if !TFDB_SANITIZED

namespace tfdb::allocation {
thread_local long count = 0;
thread_local long until_failure = -1;
}  // namespace tfdb::allocation

// Not inlined: the compiler would report `malloc` and `delete` as a mismatch.
[[gnu::noinline]] void* operator new(std::size_t bytes) {
    using namespace tfdb::allocation;
    ++count;
    if (until_failure >= 0 && until_failure-- == 0)
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

/// Total number of allocations of `call(i)`, after a warm-up.
template <class Call>
long counted(Call&& call) {
    for (int i = 0; i < kWarm; ++i)
        call(i);
    const long before = allocation::count;
    for (int i = kWarm; i < kWarm + kCounted; ++i)
        call(i);
    return allocation::count - before;
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
    // A correction and a late sample do not allocate either.
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
    CHECK_EQ(
        counted([&](int i) {
            answered += buffer.ask(store::at_stamp(world, tip, 800 + i % 199, {}), answer, failure);
            answered += buffer.ask(store::at_stamp(tip, world, std::nullopt, {}), answer, failure);
            answered += buffer.ask(store::of_newest(world, tip, {}, 0), answer, failure);
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
                 answered += buffer.ask(store::at_stamp(world, tip, 5000 + i, {}), answer, failure);
                 answered += buffer.ask(store::at_stamp(moon, tip, 900, {}), answer, failure);
                 answered += buffer.ask(store::at_stamp(world, {}, 900, {}), answer, failure);
             }),
             0);
    CHECK_EQ(answered, 0);
}

}  // namespace tfdb

#endif
