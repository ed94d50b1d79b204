// A row of a batch equals the single lookup of its stamp, bit for bit. This holds in snapshots and
// transactions, in both layouts, for any other stamps, and beside other commits. Random stores make
// lookups take every code path.
#include <algorithm>
#include <array>
#include <deque>
#include <random>
#include <utility>
#include <vector>

#include "tfdb/store/fixture.hpp"
#include "tfdb/store/rows.hpp"
#include "tfdb/store/transaction.hpp"
#include "tfdb/testing/sanitized.hpp"

namespace tfdb {
namespace {

using namespace fixture;
using geometry::Quat;
using lookup::PolicyKind;

constexpr std::array<std::string_view, 9> kNames = {"map", "odom",   "base",  "arm", "hand",
                                                    "cam", "marker", "drift", "tip"};
constexpr std::size_t kFirstStatic = 7;  // from here on frames have static edges

const Policy kPolicies[] = {{PolicyKind::kInterpolate, lookup::kNoLimit},
                            {PolicyKind::kInterpolate, lookup::kNoLimit},
                            {PolicyKind::kInterpolate, 40},
                            {PolicyKind::kExact, lookup::kNoLimit},
                            {PolicyKind::kPrevious, lookup::kNoLimit},
                            {PolicyKind::kPrevious, 25},
                            {PolicyKind::kNearest, lookup::kNoLimit},
                            {PolicyKind::kNearest, 12},
                            {PolicyKind::kExtrapolate, lookup::kNoLimit},
                            {PolicyKind::kExtrapolate, 300}};

/// Counts of each refusal in one run: none may be 0.
struct Tally {
    std::size_t rows = 0;
    std::size_t refused = 0;
    std::size_t apart = 0;
    std::size_t infinite = 0;
    std::size_t whole = 0;  // batches without a refused row
};

/// The reads of one state.
struct Question {
    std::string_view target;
    std::string_view source;
    Policy policy;
    std::vector<StampNs> stamps;
};

/// The single result of each stamp: a pose, or the error.
struct Singles {
    std::vector<std::optional<Pose>> poses;
    std::vector<ErrorCode> codes;
    std::vector<double> rows[2];  // in both layouts, NaN where there is none

    [[nodiscard]] std::size_t first_refused() const {
        const auto none = std::find(poses.begin(), poses.end(), std::nullopt);
        return static_cast<std::size_t>(none - poses.begin());
    }
    [[nodiscard]] bool all_apart() const {
        return !codes.empty() && std::all_of(codes.begin(), codes.end(), [](ErrorCode code) {
            return code == ErrorCode::kDisconnected;
        });
    }
};

/// All NaNs are equal; all other numbers are compared bit for bit.
bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
    return a.size() == b.size() &&
           std::equal(a.begin(), a.end(), b.begin(), [](double x, double y) {
               return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y) ||
                      (std::isnan(x) && std::isnan(y));
           });
}

constexpr Layout kLayouts[] = {Layout::kPose, Layout::kMatrix};

/// `look_up(stamp, answer, failure)` returns true if it has a result.
template <class LookUp>
Singles ask_singly(const Question& question, LookUp look_up) {
    Singles singles;
    Answer answer;
    Failure failure;
    for (const StampNs stamp : question.stamps) {
        const bool found = look_up(stamp, answer, failure);
        singles.poses.push_back(found ? std::optional(answer.pose) : std::nullopt);
        singles.codes.push_back(found ? ErrorCode::kInvalidArgument : failure.code);
    }
    for (std::size_t l = 0; l < 2; ++l) {
        const std::size_t width = store::row_width(kLayouts[l]);
        singles.rows[l].resize(width * singles.poses.size());
        for (std::size_t i = 0; i < singles.poses.size(); ++i) {
            const auto& pose = singles.poses[i];
            store::write_row(pose ? &*pose : nullptr, kLayouts[l], &singles.rows[l][width * i]);
        }
    }
    return singles;
}

/// Both layouts, with NaN and with an error, compared with the single lookups.
template <class From>
void check_batches(From& from, const Question& q, const Singles& singles) {
    const std::size_t refused = singles.first_refused();
    for (std::size_t l = 0; l < 2; ++l) {
        std::vector<double> rows(singles.rows[l].size());
        for (const Missing missing : {Missing::kNan, Missing::kThrow}) {
            const bool throws = missing == Missing::kThrow && refused < q.stamps.size();
            testing::count_check();
            try {
                from.lookup_many(q.target, q.source, q.stamps, q.policy, kLayouts[l], missing,
                                 rows);
                if (throws || !same_bits(rows, singles.rows[l]))
                    testing::report_failure(__FILE__, __LINE__, "not the single lookups' rows");
            } catch (const Error& error) {
                if (!throws || error.code() != singles.codes[refused] ||
                    error.detail().index != refused) {
                    testing::report_failure(__FILE__, __LINE__, error.what());
                }
            }
        }
    }
}

/// All frames' edges at one stamp, or at their newest ones, compared with lookups of frame and
/// parent.
template <class From>
void check_edges(const From& from, std::span<const std::optional<std::string>> parents,
                 std::optional<StampNs> stamp, Policy policy) {
    std::vector<double> expected;
    std::optional<std::size_t> refused;
    std::vector<FrameRef> frames;
    Answer answer;
    Failure failure;
    for (std::size_t i = 0; i < kNames.size(); ++i) {
        frames.push_back({.name = kNames[i]});
        const std::string parent = parents[i].value_or("");
        tfdb::Question one = store::at_stamp(parent, kNames[i], stamp, policy);
        bool found = parents[i] && from.ask(one, answer, failure);
        // If a policy's parents form a cycle, a walk may take the other direction or fail. The edge
        // alone has a result.
        const bool astray = found ? answer.edges.size() != 1 || answer.edges.front().inverted
                                  : failure.code == ErrorCode::kDisconnected;
        one.kind = tfdb::Question::kEdge;
        if (parents[i] && stamp && astray)
            found = from.ask(one, answer, failure) && geometry::is_finite(answer.pose);
        if (!found && !refused)
            refused = i;
        expected.resize(7 * frames.size());
        store::write_row(found ? &answer.pose : nullptr, &expected[7 * i]);
    }
    std::vector<double> rows(expected.size());
    std::vector<float> floats(expected.size());
    for (int again = 0; again < 2; ++again) {  // by names, then by handles
        from.lookup_edges(std::span(frames), stamp, policy, Missing::kNan, std::span(rows));
        CHECK(same_bits(rows, expected));
    }
    from.lookup_edges(std::span(frames), stamp, policy, Missing::kNan, std::span(floats));
    for (std::size_t i = 0; i < rows.size(); ++i)
        CHECK(floats[i] == static_cast<float>(rows[i]) || std::isnan(rows[i]));
    try {
        from.lookup_edges(std::span(frames), stamp, policy, Missing::kThrow, std::span(rows));
        CHECK(!refused);
    } catch (const Error& error) {
        CHECK(refused && error.detail().index == *refused);
    }
}

/// Whether a result exists, and the error if not; also at the latest common time.
void check_whether(const StoreReader& reads, const Question& q, const Singles& singles) {
    Answer answer;
    Failure failure;
    for (std::size_t i = 0; i < q.stamps.size(); ++i) {
        tfdb::Question can = store::at_stamp(q.target, q.source, q.stamps[i], q.policy);
        can.kind = tfdb::Question::kCan;
        const bool found = reads.ask(can, answer, failure);
        CHECK(found == singles.poses[i].has_value());
        CHECK(found || failure.code == singles.codes[i]);
    }
    tfdb::Question newest = store::at_stamp(q.target, q.source, std::nullopt, q.policy);
    const bool found = reads.ask(newest, answer, failure);
    newest.kind = tfdb::Question::kCan;
    CHECK_EQ(reads.ask(newest, answer, failure), found);
}

void check_points(const StoreReader& reads, const Question& q, const Singles& singles) {
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    std::vector<double> points;
    std::vector<double> moved;
    for (std::size_t i = 0; i < q.stamps.size(); ++i) {
        const double d = static_cast<double>(i);
        const geometry::Vec3 p{1.5 - d, 0.25 * d, 3.0 / (1.0 + d)};
        const auto& pose = singles.poses[i];
        const geometry::Vec3 there =
            pose ? geometry::apply(*pose, p) : geometry::Vec3{kNan, kNan, kNan};
        points.insert(points.end(), {p.x, p.y, p.z});
        moved.insert(moved.end(), {there.x, there.y, there.z});
    }
    reads.transform_points(q.target, q.source, points.data(), 3, q.stamps.size(), q.stamps,
                           q.policy, Missing::kNan, points.data(), 3);
    CHECK(same_bits(points, moved));
}

/// A store with random changes, and its held snapshots.
class World {
public:
    World(unsigned seed, std::optional<StampNs> history)
        : random_(seed), buffer_(keeping(history)) {}

    void step() {
        const auto event = below(200);
        try {
            if (event < 110)
                append(1 + below(4));
            else if (event < 125)
                append(20 + below(200));
            else if (event < 145)
                late();
            else if (event < 170)
                reparent();
            else if (event < 182)
                fix();
            else if (event < 185)
                change_kind();
            else if (event < 192)
                abort_one();
            else if (event < 197)
                buffer_.remove_frame(any_name(), true);
            else if (event == 197 && below(5) == 0)
                empty();
            else
                swap_roles();
        } catch (const Error& refused) {
            // Refused for a cycle, a stamp that is too old, or a removed frame. No other error is
            // valid.
            const ErrorCode code = refused.code();
            CHECK(code == ErrorCode::kCycle || code == ErrorCode::kTooOld ||
                  code == ErrorCode::kUnknownFrame || code == ErrorCode::kStaticConflict);
        }
    }

    void ask(Tally& tally) {
        const Question q = question();
        FrameHandle to;
        FrameHandle from;
        const Snapshot snapshot = buffer_.snapshot();
        if (!snapshot.find_frame(q.target, to) || !snapshot.find_frame(q.source, from))
            return;
        const Singles singles = ask_singly(q, [&](StampNs stamp, Answer& answer, Failure& failure) {
            return snapshot.ask(store::at_stamp(to, from, stamp, q.policy), answer, failure);
        });
        const Singles fresh = ask_singly(q, [&](StampNs stamp, Answer& answer, Failure& failure) {
            return buffer_.ask(store::at_stamp(to, from, stamp, q.policy), answer, failure);
        });
        CHECK(same_bits(singles.rows[0], fresh.rows[0]) && singles.codes == fresh.codes);
        for (const StoreReader* const reads :
             std::initializer_list<const StoreReader*>{&snapshot, &buffer_})
            check_whether(*reads, q, singles);
        check_batches(snapshot, q, singles);
        check_batches(buffer_, q, singles);
        check_points(buffer_, q, singles);
        check_points(snapshot, q, singles);
        Transaction transaction(buffer_, {});
        check_batches(transaction, q, singles);
        for (const auto& stamp :
             {std::optional<StampNs>(q.stamps.front()), std::optional<StampNs>()})
            ask_edges(snapshot, transaction, stamp, q.policy);
        transaction.abort();
        add_to(tally, singles);
    }

    /// Holds a state with its results.
    void hold() {
        Held held{buffer_.snapshot(), {}, 0};
        for (int i = 0; i < 4; ++i) {
            Question q = question();
            FrameHandle to;
            FrameHandle from;
            if (!held.snapshot.find_frame(q.target, to) ||
                !held.snapshot.find_frame(q.source, from))
                continue;
            Singles said = ask_singly(q, [&](StampNs stamp, Answer& answer, Failure& failure) {
                return held.snapshot.ask(store::at_stamp(to, from, stamp, q.policy), answer,
                                         failure);
            });
            held.said.emplace_back(std::move(q), std::move(said));
        }
        held_.push_back(std::move(held));
    }
    /// Held states return the same results as before.
    void check_held(Tally& tally) {
        for (Held& held : held_) {
            for (const auto& [q, said] : held.said) {
                check_batches(held.snapshot, q, said);
                tally.rows += 4 * q.stamps.size();
            }
        }
    }
    void release() {
        if (held_.size() > 2)
            held_.pop_front();
    }

private:
    struct Held {
        Snapshot snapshot;
        std::vector<std::pair<Question, Singles>> said;
        std::size_t checked = 0;
    };
    struct Edge {
        std::size_t parent = 0;
        StampNs newest = 0;
        Pose pose = geometry::identity();
    };

    std::size_t below(std::size_t n) { return random_() % n; }
    double uniform(double low, double high) {
        return std::uniform_real_distribution<double>(low, high)(random_);
    }
    std::string_view any_name() { return kNames[below(kNames.size())]; }

    StampNs gap() {
        constexpr StampNs kGaps[] = {1, 2, 7, 10, 10, 33, 50, 1000};
        return kGaps[below(std::size(kGaps))];
    }

    /// A pose after `before`: mostly near, sometimes the negated quaternion, rotated by half a
    /// turn, or very far away.
    Pose pose_after(const Pose& before) {
        const Quat& q = before.rotation;
        Pose pose = before;
        const auto kind = below(40);
        if (kind < 3) {
            pose.rotation = {-q.x, -q.y, -q.z, -q.w};
        } else if (kind < 6) {
            pose.rotation = geometry::multiply(q, {0.0, 0.0, 1.0, 0.0});
        } else if (kind < 8) {
            pose.rotation = geometry::normalized({0.0, 0.0, uniform(-1, 1), uniform(-1, 1)});
        } else {
            const double turn = kind < 20 ? 0.01 : kind < 30 ? 0.1 : 1.0;
            pose.rotation = geometry::normalized(geometry::multiply(
                q, {uniform(-turn, turn), uniform(-turn, turn), uniform(-turn, turn), 1.0}));
        }
        pose.translation = {uniform(-9, 9), uniform(-9, 9), uniform(-9, 9)};
        if (below(400) == 0)
            pose.translation = {1e308 * uniform(-1, 1), 1e308, -0.0};
        return pose;
    }

    void set_moving(std::size_t child, std::size_t parent, StampNs stamp) {
        if (parent == child)
            return;
        Edge& edge = edges_[child];
        const Pose pose = pose_after(edge.pose);
        set(buffer_, kNames[parent], kNames[child], stamp, pose, "robot");
        edge.parent = parent;
        edge.newest = std::max(edge.newest, stamp);
        edge.pose = pose;
    }
    std::size_t any_moving() { return below(kFirstStatic); }

    void append(std::size_t samples) {
        const std::size_t child = any_moving();
        for (std::size_t i = 0; i < samples; ++i) {
            now_ += samples > 10 ? 3 : 0;
            const Edge& edge = edges_[child];
            set_moving(child, edge.parent, std::max(now_, edge.newest) + gap() % 40);
        }
        now_ = std::max(now_, edges_[child].newest);
    }
    void empty() {
        buffer_.clear();
        (void)buffer_.compact();
    }
    void late() {
        const std::size_t child = any_moving();
        const StampNs back = static_cast<StampNs>(below(below(4) == 0 ? 3000 : 60));
        const Edge& edge = edges_[child];
        set_moving(child, below(3) == 0 ? below(kFirstStatic) : edge.parent,
                   std::max<StampNs>(edge.newest - back, 0));
    }
    void reparent() {
        const std::size_t child = any_moving();
        set_moving(child, below(kNames.size()), edges_[child].newest + gap());
    }
    /// The child becomes its parent's parent, at one stamp.
    void swap_roles() {
        const std::size_t child = any_moving();
        const std::size_t parent = edges_[child].parent;
        const std::size_t other = below(kFirstStatic);
        if (parent >= kFirstStatic || parent == child || other == child || other == parent)
            return;
        const StampNs stamp = std::max(edges_[child].newest, edges_[parent].newest) + gap();
        const Pose pose = pose_after(edges_[child].pose);
        const TransformView both[] = {{kNames[other], kNames[child], stamp, pose},
                                      {kNames[child], kNames[parent], stamp + gap(), pose}};
        buffer_.set_transforms(both, false, "");
        edges_[child].parent = other;
        edges_[parent].parent = child;
        edges_[child].newest = edges_[parent].newest = both[1].stamp;
    }
    void fix() {
        const std::size_t child = kFirstStatic + below(kNames.size() - kFirstStatic);
        set_static(buffer_, kNames[below(4) == 0 ? below(kFirstStatic) : 2], kNames[child],
                   pose_after(edges_[child].pose));
    }
    /// A moving edge becomes static, or a static one moving.
    void change_kind() {
        const std::size_t child = below(kNames.size());
        const std::size_t parent = edges_[child].parent;
        if (parent == child)
            return;
        buffer_.set_transform({kNames[parent], kNames[child], edges_[child].newest + gap(),
                               pose_after(edges_[child].pose)},
                              below(2) == 0, "", {true, false});
    }
    void abort_one() {
        Transaction transaction(buffer_, {});
        const std::size_t child = any_moving();
        const TransformView sample{kNames[child == 0 ? 1 : 0], kNames[child],
                                   edges_[child].newest + 1, pose_after(edges_[child].pose)};
        transaction.set_transforms({&sample, 1}, false, "tester");
        transaction.abort();
    }

    Question question() {
        Question q{any_name(), any_name(), kPolicies[below(std::size(kPolicies))], {}};
        constexpr std::size_t kCounts[] = {1, 2, 3, 5, 17, 40, 150, 300};
        const std::size_t count = kCounts[below(std::size(kCounts))];
        std::vector<StampNs> stored;
        for (const std::size_t edge : {any_moving(), any_moving()}) {
            try {
                const Samples samples = buffer_.samples(kNames[edge]);
                stored.insert(stored.end(), samples.stamps.begin(), samples.stamps.end());
            } catch (const UnknownFrame&) {
                continue;  // removed
            }
        }
        const StampNs span = below(3) == 0 ? 50 : below(2) == 0 ? 600 : now_ + 500;
        const StampNs low = std::max<StampNs>(0, now_ - span - static_cast<StampNs>(below(1000)));
        while (q.stamps.size() < count) {
            const bool at_sample = !stored.empty() && below(3) == 0;
            const StampNs stamp =
                at_sample ? stored[below(stored.size())] + static_cast<StampNs>(below(3)) - 1
                          : low + static_cast<StampNs>(below(static_cast<std::size_t>(span)));
            q.stamps.push_back(std::max<StampNs>(stamp, 0));
        }
        if (below(2) == 0)
            std::sort(q.stamps.begin(), q.stamps.end());
        return q;
    }

    /// Parents are those of the walk, because a policy may choose others than `parent_of`.
    void ask_edges(const Snapshot& snapshot, const Transaction& transaction,
                   std::optional<StampNs> stamp, Policy policy) const {
        std::vector<std::optional<std::string>> parents;
        Answer answer;
        Failure failure;
        for (const std::string_view name : kNames) {
            tfdb::Question own = store::of_edges(stamp, policy);
            own.source.name = name;
            parents.emplace_back();
            if (!snapshot.ask(own, answer, failure))
                continue;
            const EdgeUse& use = answer.edges.front();
            parents.back() = snapshot.frame_name(use.parent, use.parent_generation);
        }
        check_edges(snapshot, parents, stamp, policy);
        check_edges(static_cast<const StoreReader&>(buffer_), parents, stamp, policy);
        check_edges(transaction, parents, stamp, policy);
    }

    static void add_to(Tally& tally, const Singles& singles) {
        tally.rows += 15 * singles.poses.size();  // twelve batches, two singly, points
        tally.whole += singles.first_refused() == singles.poses.size() ? 1 : 0;
        tally.apart += singles.all_apart() ? 1 : 0;
        for (std::size_t i = 0; i < singles.poses.size(); ++i) {
            tally.refused += singles.poses[i] ? 0 : 1;
            tally.infinite += singles.codes[i] == ErrorCode::kInvalidTransform ? 1 : 0;
        }
    }

    std::mt19937_64 random_;
    Buffer buffer_;
    std::array<Edge, kNames.size()> edges_{};
    StampNs now_ = 100;
    std::deque<Held> held_;
};

/// Under sanitizers: only one seed.
unsigned seeds() {
    constexpr unsigned kSeeds = 3;
    const char* const wish = std::getenv("TFDB_MODEL_SEEDS");
    return wish == nullptr ? kSeeds : static_cast<unsigned>(std::max(1, std::atoi(wish)));
}

}  // namespace

TFDB_TEST(every_way_to_ask_has_the_same_answer) {
    Tally tally;
    for (unsigned seed = 1; seed <= seeds(); ++seed) {
        World world(seed, seed % 3 == 0 ? std::optional<StampNs>(2000) : std::nullopt);
        for (int round = 0; round < 700; ++round) {
            for (int i = 0; i < 8; ++i)
                world.step();
            world.ask(tally);
        }
    }
    std::printf(
        "  seeds 1 to %u: %zu rows, %zu batches without a refused row; refused stamps %zu, "
        "%zu of them not finite; %zu batches of frames in two trees\n",
        seeds(), tally.rows, tally.whole, tally.refused, tally.infinite, tally.apart);
    CHECK(tally.rows > 150'000 * seeds());
    CHECK(tally.whole > 0 && tally.refused > 0 && tally.infinite > 0 && tally.apart > 0);
}

TFDB_TEST(what_a_held_snapshot_answers_stays_what_it_is) {
    Tally tally;
    for (unsigned seed = 101; seed <= 100 + seeds(); ++seed) {
        World world(seed, std::nullopt);
        for (int round = 0; round < testing::rounds(60); ++round) {
            for (int i = 0; i < 150; ++i)
                world.step();
            world.check_held(tally);
            if (round % 8 == 0) {  // each is held for over 1,000 commits
                world.release();
                world.hold();
            }
        }
    }
    std::printf("  seeds 101 to %u: %zu rows\n", 100 + seeds(), tally.rows);
    CHECK(tally.rows > testing::rounds(50'000) * seeds());
}

}  // namespace tfdb
