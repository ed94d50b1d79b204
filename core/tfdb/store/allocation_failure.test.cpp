// Allocation failures at every point of a write, in every engine. The write stores everything or
// nothing, and reports which. It releases its locks, and the same call then succeeds. Long names
// force heap allocations.
#include <bit>
#include <functional>
#include <sstream>

#include "tfdb/store/allocation.test.hpp"
#include "tfdb/store/fixture.hpp"
#include "tfdb/store/transaction.hpp"

#if !TFDB_SANITIZED

namespace tfdb {
namespace {

using namespace fixture;

std::string long_name(std::string_view name) {
    return "robot_7/a_name_that_no_small_string_buffer_takes/" + std::string(name);
}
const std::string kMap = long_name("map");
const std::string kOdom = long_name("odom");
const std::string kBase = long_name("base");
const std::string kEye = long_name("eye");
const std::string kLeaf = long_name("leaf");
const std::string kNew = long_name("new");
const std::string kNewer = long_name("newer");
const std::string kAfter = long_name("after");
const std::string kAuthor = long_name("author");
const std::string kOther = long_name("other");

/// map <- odom <- base, late samples and another parent of `odom` once; base <- eye is static.
void fill(Buffer& buffer) {
    for (const StampNs stamp : {10, 20, 30, 25, 40, 50}) {
        set(buffer, kMap, kOdom, stamp, pose_of(1), kAuthor);
        set(buffer, kOdom, kBase, stamp, pose_of(2), kAuthor);
    }
    buffer.set_transform({long_name("site"), kOdom, 35, pose_of(7)}, false, kAuthor);
    buffer.set_transform({kBase, kEye, 0, pose_of(3)}, true, kAuthor);
    for (const StampNs stamp : {10, 30})
        set(buffer, kMap, kLeaf, stamp, pose_of(4), kAuthor);
}

/// As THROWN, but std::bad_alloc propagates to the caller.
template <class E, class Body>
void must_throw(Body body) {
    try {
        body();
        CHECK(false);
    } catch (const E&) {
        testing::count_check();
    }
}

using Call = std::function<void(Buffer&)>;
struct Named {
    const char* name;
    Call call;
};

void set_all(Buffer& buffer) {
    const TransformView batch[] = {{kMap, kOdom, 60, pose_of(5)},
                                   {kOdom, kBase, 60, pose_of(6)},
                                   {kMap, kOdom, 70, pose_of(7)}};
    buffer.set_transforms(batch, false, kOther);
}
void set_many(Buffer& buffer) {
    std::vector<TransformView> batch;
    for (StampNs stamp = 60; stamp < 100; ++stamp)
        batch.push_back({kOdom, kBase, stamp, pose_of(5)});
    buffer.set_transforms(batch, false, kOther);
}
void set_late(Buffer& buffer) {
    std::vector<TransformView> batch;
    for (StampNs stamp = 11; stamp < 20; ++stamp)
        batch.push_back({kMap, kLeaf, stamp % 2 == 0 ? stamp : 22 - stamp, pose_of(5)});
    buffer.set_transforms(batch, false, kOther);
}
void set_new(Buffer& buffer) {
    const TransformView batch[] = {{kBase, kNew, 60, pose_of(5)}, {kNew, kNewer, 60, pose_of(6)}};
    buffer.set_transforms(batch, false, kOther);
}
void set_cycle(Buffer& buffer) {
    const TransformView batch[] = {{kMap, kNew, 60, pose_of(5)}, {kEye, kMap, 60, pose_of(6)}};
    must_throw<CycleError>([&] { buffer.set_transforms(batch, false, kOther); });
}
void set_partly(Buffer& buffer) {
    const TransformView batch[] = {{kMap, kNew, 50, pose_of(3)}, {kMap, "", 50, pose_of(4)}};
    const WriteResult result =
        buffer.write({.transforms = batch, .authority = kOther, .partial = true});
    CHECK_EQ(result.refused.size(), 1U);
}
void remove_all(Buffer& buffer) {
    const std::string_view names[] = {kMap};
    buffer.remove_frames(names, true);
}
void write_in(Buffer& buffer, const TransactionOptions& options) {
    Transaction tx(buffer, options);
    (void)tx.lookup_transform(kMap, kBase);
    (void)tx.lookup_latest_transform(kOdom, kBase);
    CHECK(!tx.has_frame(kNew));
    const TransformView batch[] = {{kMap, kOdom, 60, pose_of(3)},
                                   {kBase, kNew, 60, pose_of(4)},
                                   {kMap, kOdom, 55, pose_of(4)}};
    tx.set_transforms(batch, false, kOther);
    tx.reparent(kNewer, kNew, std::nullopt, pose_of(5), kOther);
    tx.remove_frame(kEye, true);
    CHECK_EQ(tx.latest_common_time(kMap, kNewer), 50);
    tx.commit();
}
void write_plainly_in_transaction(Buffer& buffer) {
    const TransformView batch[] = {{kMap, kLeaf, 60, pose_of(3)}, {kMap, kLeaf, 50, pose_of(3)}};
    Transaction tx(buffer);
    tx.set_transforms(batch, false, kOther);
    tx.commit();
}

const std::vector<Named>& writes() {
    static const std::vector<Named> all = {
        {"set", [](Buffer& b) { set(b, kMap, kOdom, 60, pose_of(5), kOther); }},
        {"set two edges", set_all},
        {"set many", set_many},
        {"set late", set_late},
        {"set new frames", set_new},
        {"set static", [](Buffer& b) { set_static(b, kBase, kEye, pose_of(5)); }},
        {"re-parent", [](Buffer& b) { set(b, kMap, kBase, 60, pose_of(5), kOther); }},
        {"refuse a cycle", set_cycle},
        {"set partly", set_partly},
        {"clear", [](Buffer& b) { b.clear(); }},
        {"compact", [](Buffer& b) { (void)b.compact(); }},
        {"remove", [](Buffer& b) { b.remove_frame(kLeaf, false); }},
        {"remove all", remove_all},
        {"transaction", [](Buffer& b) { write_in(b, {}); }},
        {"transaction alone", [](Buffer& b) { write_in(b, {.alone = true}); }},
        {"plain transaction", write_plainly_in_transaction},
    };
    return all;
}

void put(std::ostream& out, const Pose& pose) {
    for (const std::uint64_t word : std::bit_cast<std::array<std::uint64_t, 7>>(pose))
        out << word << ' ';
}

/// The whole content of a store, as text.
std::string all_of(const Buffer& buffer) {
    std::ostringstream out;
    out << buffer.commit() << ' ' << buffer.counters().commits << '\n';
    for (const FrameInfo& info : buffer.tree(std::nullopt)) {
        out << info.name << ' ' << info.parent.value_or("-") << ' ' << info.is_static << ' '
            << info.authority << ' ' << info.late << ' ' << info.longest_gap << '\n';
        const Samples samples = buffer.samples(info.name);
        for (std::size_t i = 0; i < samples.stamps.size(); ++i) {
            out << "  " << samples.stamps[i] << ' ' << samples.parents[i] << ' ';
            put(out, samples.poses[i]);
            out << '\n';
        }
    }
    return out.str();
}

BufferOptions options_of(std::size_t engine) {
    BufferOptions options;
    options.history_ns = std::nullopt;
    options.concurrency = static_cast<Concurrency>(engine);
    return options;
}

/// The state after a write, and its allocations.
struct Clean {
    std::string before;
    std::string after;
    std::size_t used_before = 0;
    std::size_t used_after = 0;
};

Clean clean_run(const BufferOptions& options, const Call& write) {
    Buffer buffer(options);
    fill(buffer);
    Clean clean{all_of(buffer), {}, buffer.memory().used_bytes, 0};
    write(buffer);
    clean.after = all_of(buffer);
    clean.used_after = buffer.memory().used_bytes;
    return clean;
}

/// Makes the write fail at its n-th allocation. Checks the state after it, and that a retry
/// succeeds.
void judge_failure(Buffer& buffer, const Call& write, const Clean& clean, long n, long& allocated) {
    bool failed = false;
    allocation::until_failure = n;
    const long before = allocation::count;
    try {
        write(buffer);
    } catch (const std::bad_alloc&) {
        failed = true;
    }
    allocation::until_failure = -1;
    allocated = allocation::count - before;
    CHECK_EQ(all_of(buffer), failed ? clean.before : clean.after);
    if (failed) {
        write(buffer);
        CHECK_EQ(all_of(buffer), clean.after);
    }
    // The region has no leaked blocks either.
    CHECK(buffer.memory().used_bytes <= clean.used_after);
    set(buffer, kMap, kAfter, 200, pose_of(9));  // no lock is held
    CHECK_EQ(number_of(buffer.lookup_transform(kMap, kAfter, 200).pose), 9.0);
}

}  // namespace

TFDB_TEST(allocation_that_fails_in_a_write_stores_nothing_and_keeps_no_lock) {
    for (std::size_t engine = 0; engine < kConcurrencies; ++engine) {
        const BufferOptions options = options_of(engine);
        long allocated_in_all = 0;
        for (const Named& write : writes()) {
            const Clean clean = clean_run(options, write.call);
            long allocated = 0;
            // Does not stop at the first success: a sort, for example, can work without its buffer.
            for (long n = 0; n <= allocated; ++n) {
                Buffer buffer(options);
                fill(buffer);
                judge_failure(buffer, write.call, clean, n, allocated);
            }
            allocated_in_all += allocated;
        }
        CHECK(allocated_in_all > 100);
    }
}

TFDB_TEST(allocation_of_blocks_that_fails_is_no_commit) {
    for (std::size_t engine = 0; engine < kConcurrencies; ++engine) {
        BufferOptions options = options_of(engine);
        int refused_in_all = 0;
        for (const Named& write : writes()) {
            options.memory_limit.reset();
            const Clean clean = clean_run(options, write.call);
            bool failed = true;
            // The limit rises by the smallest block size.
            for (options.memory_limit = clean.used_before; failed; *options.memory_limit += 64) {
                Buffer buffer(options);
                try {
                    fill(buffer);
                } catch (const CapacityExceeded&) {
                    continue;
                }
                try {
                    write.call(buffer);
                    failed = false;
                } catch (const CapacityExceeded&) {
                    ++refused_in_all;
                }
                CHECK_EQ(all_of(buffer), failed ? clean.before : clean.after);
            }
        }
        CHECK(refused_in_all > 0);
    }
}

TFDB_TEST(allocation_that_fails_in_a_read_changes_nothing_and_keeps_no_lock) {
    const std::vector<Named> reads = {
        {"frames", [](Buffer& b) { CHECK_EQ(b.frames().size(), 6U); }},
        {"frame_info", [](Buffer& b) { CHECK_EQ(b.frame_info(kOdom).authority, kAuthor); }},
        {"tree", [](Buffer& b) { CHECK_EQ(b.tree(30).size(), 6U); }},
        {"samples", [](Buffer& b) { CHECK_EQ(b.samples(kOdom).poses.size(), 7U); }},
        {"lookup", [](Buffer& b) { CHECK_EQ(b.lookup_transform(kMap, kBase, 20).stamp, 20); }},
        {"latest", [](Buffer& b) { (void)b.lookup_latest_transform(kMap, kBase); }},
        {"error",
         [](Buffer& b) {
             must_throw<UnknownFrame>([&] { (void)b.lookup_transform(kNew, kMap, 20); });
         }},
        {"velocity",
         [](Buffer& b) { (void)b.lookup_velocity(kMap, kBase, 20, 10, kOdom, {}, kBase); }},
        {"path", [](Buffer& b) { CHECK(!b.path_stamps(kMap, kBase, {}, {}).empty()); }},
        {"snapshot", [](Buffer& b) { CHECK_EQ(b.snapshot().frames().size(), 6U); }},
        {"memory", [](Buffer& b) { CHECK(b.memory().authority_bytes > kAuthor.size()); }},
    };
    for (std::size_t engine = 0; engine < kConcurrencies; ++engine) {
        Buffer buffer(options_of(engine));
        fill(buffer);
        const std::string before = all_of(buffer);
        for (const Named& read : reads) {
            long allocated = 0;
            for (long n = 0; n <= allocated; ++n) {
                allocation::until_failure = n;
                const long counted = allocation::count;
                try {
                    read.call(buffer);
                } catch (const std::bad_alloc&) {
                    CHECK(allocation::count - counted > n);
                }
                allocation::until_failure = -1;
                allocated = allocation::count - counted;
                CHECK_EQ(all_of(buffer), before);
            }
        }
        set(buffer, kMap, kAfter, 200, pose_of(9));
    }
}

}  // namespace tfdb

#endif
