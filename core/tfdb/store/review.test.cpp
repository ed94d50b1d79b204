// Executions that once broke a promise: of what an answer depends on, of who may wait for whom.
#include <array>

#include "tfdb/store/transaction_fixture.test.hpp"

namespace tfdb {
namespace {

using namespace fixture;

constexpr std::array kFarPolicies = {lookup::PolicyKind::kNearest,
                                     lookup::PolicyKind::kExtrapolate};

/// At stamp 2, a hangs below m by its first sample, and m is a root.
void far_from_samples(Buffer& buffer) {
    set_static(buffer, "a", "s", pose_of(1));
    set_static(buffer, "m", "t", pose_of(2));
    set(buffer, "m", "a", 10, pose_of(3));
    set_static(buffer, "a", "x", pose_of(4));
    set_static(buffer, "w_root", "w", pose_of(5));
    set_static(buffer, "elsewhere", "d", pose_of(6));
}

/// Above m the chain comes back to a: legal in time, as m leaves x before a's first sample.
void bend(Buffer& buffer) {
    const TransformView batch[] = {{"x", "m", 1, pose_of(7)}, {"w", "m", 5, pose_of(8)}};
    buffer.set_transforms(batch, false, "other");
}

void overwrite(Buffer& buffer) {
    for (StampNs stamp = 2; stamp < 200; ++stamp)
        set(buffer, "map", "base", stamp, pose_of(static_cast<double>(stamp)));
}

}  // namespace

/// Far from the samples a path depends on what lies above the meeting point as well.
TFDB_TEST(transaction_depends_on_the_chain_above_the_meeting_point) {
    if (skipped_in({Concurrency::kFine}, "nothing is validated"))
        return;
    for (const auto kind : kFarPolicies) {
        Buffer buffer(keeping(std::nullopt));
        far_from_samples(buffer);
        const Policy policy{kind};
        Transaction tx(buffer);
        const Pose seen = tx.lookup_transform("t", "s", 2, policy).pose;
        std::thread other([&] { bend(buffer); });
        if (engine() == Concurrency::kSnapshot)
            other.join();  // in other engines it waits for the transaction
        put_static(tx, "elsewhere", "new", 9);
        bool committed = true;
        try {
            tx.commit();
        } catch (const Conflict&) {
            committed = false;
        }
        if (other.joinable())
            other.join();
        CHECK(apart(seen, buffer.lookup_transform("t", "s", 2, policy).pose) > 1e-3);
        CHECK(engine() != Concurrency::kSnapshot || !committed);
    }
}

/// What is gone is said to be gone; in no engine does the thread wait for itself.
TFDB_TEST(snapshot_that_is_too_old_does_not_wait_for_its_own_thread) {
    for (const bool alone : {false, true}) {
        BufferOptions options = keeping(10);
        options.snapshot_memory = 0;
        Buffer buffer(options);
        set(buffer, "map", "base", 1, pose_of(1));
        const Snapshot snapshot = buffer.snapshot();
        overwrite(buffer);
        CHECK(THROWN(SnapshotTooOld, snapshot.lookup_transform("map", "base", 1)));
        Transaction tx(buffer, {.alone = alone});
        CHECK(THROWN(SnapshotTooOld, snapshot.lookup_transform("base", "map", 1)));
        CHECK_EQ(latest(tx, "map", "base"), 199.0);
    }
}

}  // namespace tfdb
