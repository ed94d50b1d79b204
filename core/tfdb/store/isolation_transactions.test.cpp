// Anomalies of transactions, one by one, in every engine and in both directions of a path.
#include "tfdb/store/isolation.test.hpp"

namespace tfdb {
namespace {

using namespace isolation;

/// map <- x, map <- y and map <- mark. x has a moving child, so that paths have two edges.
void prepare(Buffer& buffer, double x, double y, double mark) {
    const TransformView batch[] = {{"map", "y", 20, pose_of(y)},
                                   {"map", "x", 20, pose_of(9)},
                                   {"map", "mark", 20, pose_of(mark)},
                                   {"map", "x", 20, pose_of(x)}};
    buffer.set_transforms(batch, false, "");
}
int read(Transaction& tx, Direction direction, const char* frame) {
    return whole(newest(tx, direction, "map", frame));
}

// -- lost_update

/// Two transactions add one to the same edge. Both read before either writes.
int lost_update(const Case& c) {
    Buffer buffer(options_of(c.engine));
    prepare(buffer, 5, 0, 0);
    Meeting meeting(c.engine);
    const auto increment = [&](StampNs stamp) {
        until_committed(buffer, [&](Transaction& tx, bool first) {
            const int seen = read(tx, c.direction, "x");
            if (first)
                meeting.meet(2);
            put(tx, "map", "x", stamp, 77);  // replaced in the same transaction
            put(tx, "map", "x", stamp, seen + 1);
        });
    };
    side_by_side({[&] { increment(30); }, [&] { increment(30); }});
    return whole(newest(buffer, c.direction, "map", "x"));
}

// -- write_skew

/// Each transaction ends its own duty if it sees both on duty. One must stay on duty.
int write_skew(const Case& c) {
    Buffer buffer(options_of(c.engine));
    prepare(buffer, 1, 1, 0);
    Meeting meeting(c.engine);
    const auto leave = [&](const char* frame) {
        until_committed(buffer, [&](Transaction& tx, bool first) {
            const int x = read(tx, c.direction, "x");
            const int y = read(tx, c.direction, "y");
            if (first)
                meeting.meet(2);
            if (x + y == 2)
                put(tx, "map", frame, 30, 0);
        });
    };
    side_by_side({[&] { leave("x"); }, [&] { leave("y"); }});
    return whole(newest(buffer, c.direction, "map", "x")) +
           whole(newest(buffer, c.direction, "map", "y"));
}

// -- phantoms: one reads a result and writes it to `mark`; one reads `mark` and changes the result

struct Outcome {
    int mark;    // what the first one saw
    int change;  // what the second one made of the mark that it saw
};

template <class Answer, class Change>
Outcome phantom(const Case& c, Buffer& buffer, const Answer& answer, const Change& change) {
    Meeting meeting(c.engine);
    Outcome outcome{};
    side_by_side({[&] {
                      until_committed(buffer, [&](Transaction& tx, bool first) {
                          outcome.mark = answer(tx);
                          if (first)
                              meeting.meet(2);
                          put(tx, "map", "mark", 40, outcome.mark);
                      });
                  },
                  [&] {
                      until_committed(buffer, [&](Transaction& tx, bool first) {
                          outcome.change = read(tx, c.direction, "mark");
                          if (first)
                              meeting.meet(2);
                          change(tx, outcome.change);
                      });
                  }});
    return outcome;
}

/// A sample between two others would have changed the interpolated result.
Outcome phantom_sample(const Case& c) {
    Buffer buffer(options_of(c.engine));
    prepare(buffer, 10, 0, 50);
    set(buffer, "map", "x", 40, pose_of(20));
    return phantom(
        c, buffer,
        [&](Transaction& tx) { return whole(at_stamp(tx, c.direction, "map", "x", 30)); },
        [&](Transaction& tx, int mark) { put(tx, "map", "x", 30, mark); });
}

/// A newer sample would have changed the latest result and the common time.
Outcome phantom_newest(const Case& c, bool common) {
    Buffer buffer(options_of(c.engine));
    prepare(buffer, 15, 0, 50);
    return phantom(
        c, buffer,
        [&](Transaction& tx) {
            return whole(common ? at_stamp(tx, c.direction, "map", "x", std::nullopt)
                                : newest(tx, c.direction, "map", "x"));
        },
        [&](Transaction& tx, int mark) { put(tx, "map", "x", 30, mark); });
}

/// A missing frame that another transaction makes.
Outcome phantom_frame(const Case& c) {
    Buffer buffer(options_of(c.engine));
    prepare(buffer, 1, 0, 50);
    return phantom(
        c, buffer, [](Transaction& tx) { return tx.has_frame("new") ? 50 : 15; },
        [&](Transaction& tx, int mark) { put(tx, "map", "new", 30, mark); });
}

/// Another parent changes the path: x is a child of y, which is 100 away, or of map.
Outcome phantom_reparent(const Case& c) {
    Buffer buffer(options_of(c.engine));
    prepare(buffer, 15, 100, 50);
    return phantom(
        c, buffer, [&](Transaction& tx) { return read(tx, c.direction, "x"); },
        [&](Transaction& tx, int mark) {
            // A child of y, so that T[map<-x] is the mark.
            const Pose y = newest(tx, c.direction, "map", "y");
            const Pose pose = geometry::compose(geometry::inverse(y), pose_of(mark));
            tx.reparent("x", "y", 30, pose, "tx");
        });
}

/// A clear and a new sample in one commit remove the data that was read.
Outcome phantom_clear(const Case& c) {
    Buffer buffer(options_of(c.engine));
    prepare(buffer, 15, 0, 50);
    return phantom(
        c, buffer, [&](Transaction& tx) { return read(tx, c.direction, "x"); },
        [&](Transaction& tx, int mark) {
            tx.clear();
            put(tx, "map", "x", 10, mark);
            put(tx, "map", "mark", 10, mark);
        });
}

// -- a clear without reads is ordered after concurrent commits

/// The newest x after a clear and a new sample, beside another transaction's newer sample. A clear
/// writes every moving edge without reading it, so neither transaction aborts.
int blind_clear(const Case& c) {
    Buffer buffer(options_of(c.engine));
    prepare(buffer, 1, 2, 0);
    Meeting begun(c.engine);
    Meeting changed(c.engine);
    int attempts = 0;
    side_by_side({[&] {
                      attempts = until_committed(buffer, [&](Transaction& tx, bool first) {
                          tx.clear();
                          put(tx, "map", "x", 5, 7);
                          if (first)
                              begun.arrive();
                          changed.wait_for(1);
                      });
                  },
                  [&] {
                      begun.wait_for(1);
                      set(buffer, "map", "x", 30, pose_of(30));
                      changed.arrive();
                  }});
    const bool snapshots = c.engine == Concurrency::kSnapshot;
    CHECK(!snapshots || attempts == 0);
    CHECK(!snapshots || buffer.samples("x").stamps == std::vector<StampNs>{5});
    CHECK(buffer.samples("y").stamps.empty());
    return whole(newest(buffer, c.direction, "map", "x"));
}

/// True for a serial order: the first saw 15 or the second's result of 50, and the second saw 50 or
/// the first's result of 15.
void one_after_the_other(const Outcome& outcome) {
    const bool first = outcome.mark == 15 && outcome.change == 15;
    const bool second = outcome.mark == 50 && outcome.change == 50;
    CHECK(first || second);
}

// -- non_repeatable_read

struct Twice {
    int before;
    int after;
};

/// Reads in one transaction before and after another commit. Empty if the transaction aborts.
template <class Answer, class Change>
std::optional<Twice> read_twice(Concurrency engine, Buffer& buffer, const Answer& answer,
                                const Change& change) {
    Meeting begun(engine);
    Meeting changed(engine);
    std::optional<Twice> seen;
    side_by_side({[&] {
                      Transaction tx(buffer);
                      try {
                          const int before = answer(tx);
                          begun.arrive();
                          changed.wait_for(1);
                          const int after = answer(tx);
                          tx.commit();
                          seen = Twice{before, after};
                      } catch (const Conflict&) {
                          CHECK(!tx.is_open());
                          begun.arrive();
                      }
                  },
                  [&] {
                      begun.wait_for(1);
                      change();
                      changed.arrive();
                  }});
    return seen;
}

/// Changes between the two reads: the newest sample, a sample in the middle, the parent, the frame.
std::vector<std::optional<Twice>> all_read_twice(const Case& c) {
    std::vector<std::optional<Twice>> seen;
    const auto twice = [&](const auto& answer, const auto& change) {
        Buffer buffer(options_of(c.engine));
        prepare(buffer, 10, 100, 0);
        set(buffer, "map", "x", 40, pose_of(20));
        set(buffer, "map", "y", 60, pose_of(100));
        seen.push_back(read_twice(
            c.engine, buffer, [&](Transaction& tx) { return answer(tx); },
            [&] { change(buffer); }));
    };
    const auto latest = [&](Transaction& tx) { return read(tx, c.direction, "x"); };
    const auto middle = [&](Transaction& tx) {
        return whole(at_stamp(tx, c.direction, "map", "x", 30));
    };
    twice(latest, [](Buffer& b) { set(b, "map", "x", 50, pose_of(30)); });
    twice(latest, [](Buffer& b) { set(b, "map", "x", 40, pose_of(30)); });
    twice(latest, [](Buffer& b) { set(b, "y", "x", 50, pose_of(30)); });
    twice(middle, [](Buffer& b) { set(b, "map", "x", 25, pose_of(99)); });
    twice(middle, [](Buffer& b) { set(b, "y", "x", 25, pose_of(99)); });
    twice([](Transaction& tx) { return tx.has_frame("x") ? 1 : 0; },
          [](Buffer& b) { b.remove_frame("x", false); });
    twice([](Transaction& tx) { return tx.has_frame("new") ? 1 : 0; },
          [](Buffer& b) { set(b, "map", "new", 50, pose_of(30)); });
    return seen;
}

/// Repeats `show(direction)` until the anomaly occurs in `fine`, which has no isolation.
template <class Show>
void shown_by_fine(const Show& show) {
    for (const Direction direction : {Direction::kDown, Direction::kUp}) {
        bool found = false;
        for (int i = 0; i < 200 && !found; ++i)
            found = show(Case{Concurrency::kFine, direction});
        CHECK(found);
    }
}

}  // namespace

TFDB_TEST(isolation_lost_update) {
    in_every_case([](const Case& c) { CHECK_EQ(lost_update(c), 7); });
    shown_by_fine([](const Case& c) { return lost_update(c) == 6; });
}

TFDB_TEST(isolation_write_skew) {
    in_every_case([](const Case& c) { CHECK_EQ(write_skew(c), 1); });
    shown_by_fine([](const Case& c) { return write_skew(c) == 0; });
}

TFDB_TEST(isolation_phantom_sample) {
    in_every_case([](const Case& c) {
        one_after_the_other(phantom_sample(c));
        one_after_the_other(phantom_newest(c, false));
        one_after_the_other(phantom_newest(c, true));
    });
    shown_by_fine([](const Case& c) {
        const Outcome outcome = phantom_sample(c);
        return outcome.mark == 15 && outcome.change == 50;
    });
}

TFDB_TEST(isolation_phantom_clear) {
    in_every_case([](const Case& c) { one_after_the_other(phantom_clear(c)); });
}

TFDB_TEST(isolation_blind_clear) {
    in_every_case([](const Case& c) {
        const int seen = blind_clear(c);
        CHECK(seen == 7 || (seen == 30 && c.engine != Concurrency::kSnapshot));
    });
}

TFDB_TEST(isolation_phantom_frame) {
    in_every_case([](const Case& c) { one_after_the_other(phantom_frame(c)); });
}

TFDB_TEST(isolation_phantom_reparent) {
    in_every_case([](const Case& c) { one_after_the_other(phantom_reparent(c)); });
    shown_by_fine([](const Case& c) {
        const Outcome outcome = phantom_reparent(c);
        return outcome.mark == 15 && outcome.change == 50;
    });
}

TFDB_TEST(isolation_non_repeatable_read) {
    in_every_case([](const Case& c) {
        for (const auto& seen : all_read_twice(c))
            CHECK(!seen || seen->before == seen->after);
    });
    shown_by_fine([](const Case& c) {
        const auto seen = all_read_twice(c).front();
        return seen && seen->before == 20 && seen->after == 30;
    });
}

}  // namespace tfdb
