// Many stamps in one call, block by block and all in one state: the kernels of
// geometry/batch_kernels.hpp read each edge's samples in place. Stamps that the kernels cannot
// answer are looked up singly.
#include <algorithm>
#include <array>
#include <bit>
#include <iterator>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>

#include "tfdb/store/batch_edge.hpp"
#include "tfdb/store/freshness.hpp"
#include "tfdb/store/path_stamps.hpp"
#include "tfdb/store/rows.hpp"

namespace tfdb {

using lookup::Outcome;

namespace {

using geometry::kBlock;
using store::BatchEdge;
using store::Mark;

// Up to this number of stamps, single lookups are cheaper than preparing a path.
constexpr std::size_t kFewStamps = 3;

// Number of stamps that are sorted together. Sorting fewer than kFewUnsorted does not pay.
constexpr std::size_t kPiece = 4096;
constexpr std::size_t kFewUnsorted = 64;
static_assert(kPiece % kBlock == 0);

struct Request {
    FrameId target;
    FrameId source;
    std::span<const StampNs> stamps;
    Policy policy;
    bool stop;  // at the first stamp without an answer; otherwise it gets no row
};

/// A stamp and its row.
struct Row {
    StampNs stamp;
    std::size_t index;
};

/// Working memory of one thread, reused by its calls: for a block and for the path's edges.
struct Workspace {
    geometry::PoseBlock block{};         // of the source's side, later of the whole path
    geometry::PoseBlock target_block{};  // of the target's side
    geometry::Pairs pairs;
    std::size_t source_edges = 0;
    std::vector<BatchEdge> edges;  // the source's side, then the target's
    std::vector<FrameId> path;     // the frames of both sides, and their meeting point
    std::vector<Row> rows;         // of a sorted piece
    std::vector<Row> spare;
    Failure failure;
    Answer answer;
    StampNs stamps[kBlock] = {};  // of the block, padded to a whole group
    Mark marks[kBlock] = {};
};

/// One thread's workspaces, used as a stack: a signal handler may run a batch inside a batch.
/// Threads: one. Guarantee: wait-free except for the first use of each depth.
struct Workspaces {
    std::vector<std::unique_ptr<Workspace>> all;
    std::size_t used = 0;
};

/// Takes a workspace for its lifetime.
/// Threads: one. Guarantee: as Workspaces.
class Lease {
public:
    Lease() : spaces_(here()) {
        if (spaces_.used == spaces_.all.size())
            spaces_.all.push_back(std::make_unique<Workspace>());
        space_ = spaces_.all[spaces_.used++].get();
    }
    ~Lease() { --spaces_.used; }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;

    [[nodiscard]] Workspace& operator*() const { return *space_; }

private:
    static Workspaces& here() {
        thread_local Workspaces spaces;
        return spaces;
    }

    Workspaces& spaces_;
    Workspace* space_;
};

/// Sorts the stamps of a piece, except stamps closer than a millionth of its span: a radix sort by
/// two digits, the last one first.
void put_in_order(std::span<const StampNs> stamps, std::size_t begin, Workspace& space) {
    constexpr int kDigit = 10;
    constexpr std::uint64_t kValues = 1U << kDigit;
    const auto [least, greatest] = std::minmax_element(stamps.begin(), stamps.end());
    const StampNs base = *least;
    const auto span = static_cast<std::uint64_t>(*greatest - base);
    const int ignored = std::max(static_cast<int>(std::bit_width(span)) - 2 * kDigit, 0);
    std::array<std::array<std::uint32_t, kValues>, 2> places{};
    const auto digits = [&](StampNs stamp) {
        return static_cast<std::uint64_t>(stamp - base) >> ignored;
    };
    for (const StampNs stamp : stamps) {
        ++places[0][digits(stamp) % kValues];
        ++places[1][digits(stamp) / kValues];
    }
    for (auto& digit : places)
        std::exclusive_scan(digit.begin(), digit.end(), digit.begin(), 0U);
    space.rows.resize(stamps.size());
    space.spare.resize(stamps.size());
    for (std::size_t i = 0; i < stamps.size(); ++i)
        space.spare[places[0][digits(stamps[i]) % kValues]++] = {stamps[i], begin + i};
    for (const Row& row : space.spare)
        space.rows[places[1][digits(row.stamp) / kValues]++] = row;
}

/// `emit(begin, rows, count)` consumes the block's poses of that many stamps: of rows from `begin`
/// on, or of `rows` if that is not null. A row without a pose has a mark other than kPlain.
template <class Emit>
class BatchRun {
public:
    BatchRun(const store::Store& store, const Request& request, Workspace& space, Emit emit)
        : store_(store), request_(request), space_(space), emit_(emit) {}

    Outcome operator()(const StoreView& view) {
        refused_.reset();
        only_path_.reset();
        if (!lookup::detail::check_frame(view, request_.target, 0, space_.failure) ||
            !lookup::detail::check_frame(view, request_.source, 1, space_.failure)) {
            return Outcome::kFailed;
        }
        Outcome outcome = judge_path(view);
        if (outcome == Outcome::kLapped)
            return outcome;
        stale_ = outcome == Outcome::kFailed;
        outcome = Outcome::kMismatch;
        if (request_.stamps.size() > kFewStamps && !stale_)
            outcome = open_path(view);
        if (outcome == Outcome::kLapped)
            return outcome;
        prepared_ = outcome == Outcome::kOk;
        missing_ = false;
        for (std::size_t begin = 0; begin < request_.stamps.size(); begin += kPiece) {
            outcome = answer_piece(view, begin);
            if (outcome != Outcome::kOk)
                return outcome;
        }
        // A frame may be missing because its slot was reused since.
        return missing_ ? store::unless_reused(store_, view.commit(), Outcome::kOk) : Outcome::kOk;
    }

    /// The first refused stamp.
    [[nodiscard]] const std::optional<std::size_t>& refused() const { return refused_; }

private:
    /// kFailed: a lifespan on the path has ended. Then no stamp has an answer.
    Outcome judge_path(const StoreView& view) {
        const auto name_of = [&](FrameId id) { return store_.names.name(id); };
        return store::path_unless_stale(store_, view, name_of, request_.target, request_.source,
                                        space_.failure);
    }

    /// kMismatch: the hints misled, or an edge is unsuitable for the kernels.
    Outcome open_path(const StoreView& view) {
        space_.edges.clear();
        space_.source_edges = 0;
        if (request_.target == request_.source)
            return Outcome::kOk;
        const Outcome walked =
            lookup::walk(view, request_.target, request_.source, request_.stamps.front(),
                         request_.policy, lookup::WalkMode::kHints, space_.answer, space_.failure);
        if (walked != Outcome::kOk)
            return walked == Outcome::kLapped ? walked : Outcome::kMismatch;
        const auto& up = space_.answer.source_chain;
        const auto& down = space_.answer.target_chain;
        space_.path.assign(up.begin(), up.end() - 1);
        space_.path.insert(space_.path.end(), down.begin(), down.end());
        Outcome outcome = open_side(view, up);
        space_.source_edges = space_.edges.size();
        if (outcome == Outcome::kOk)
            outcome = open_side(view, down);
        return outcome;
    }

    Outcome open_side(const StoreView& view, const std::vector<FrameId>& chain) {
        const std::size_t begin = space_.edges.size();
        for (std::size_t i = 0; i + 1 < chain.size(); ++i) {
            BatchEdge& edge = space_.edges.emplace_back();
            const Outcome outcome = edge.open(view, chain[i], chain[i + 1]);
            if (outcome != Outcome::kOk)
                return outcome;
            // Static edges at the start of a side are composed in advance. Behind a moving edge
            // each stays separate: composing them first would round differently.
            BatchEdge& before = space_.edges[begin];
            if (&before != &edge && space_.edges.size() == begin + 2 && before.is_static() &&
                edge.is_static()) {
                before.put_in_front(edge.pose());
                space_.edges.pop_back();
            }
        }
        return Outcome::kOk;
    }

    /// Answers so many stamps that their order does not matter.
    Outcome answer_piece(const StoreView& view, std::size_t begin) {
        const std::size_t all = std::min(kPiece, request_.stamps.size() - begin);
        const auto stamps = request_.stamps.subspan(begin, all);
        const bool in_order =
            !prepared_ || all < kFewUnsorted || std::is_sorted(stamps.begin(), stamps.end());
        if (!in_order)
            put_in_order(stamps, begin, space_);
        for (std::size_t at = 0; at < all; at += kBlock) {
            interruption_point();
            const std::size_t count = std::min(kBlock, all - at);
            const Row* const rows = in_order ? nullptr : &space_.rows[at];
            for (std::size_t i = 0; i < count; ++i)
                space_.stamps[i] = in_order ? stamps[at + i] : rows[i].stamp;
            std::fill_n(space_.marks, kBlock, prepared_ ? Mark::kPlain : Mark::kSingle);
            if (prepared_ && !evaluate(count))
                return Outcome::kLapped;
            for (std::size_t i = 0; i < count; ++i) {
                if (space_.marks[i] == Mark::kPlain)
                    continue;
                if (!answer_single(view, i, in_order ? begin + at + i : rows[i].index))
                    return Outcome::kLapped;
            }
            emit_(begin + at, rows, count);
        }
        if (!refused_)
            return Outcome::kOk;
        // The first refused stamp determines the reason.
        const Outcome refusal = look_up(view, request_.stamps[*refused_]);
        return refusal == Outcome::kOk ? Outcome::kLapped : refusal;
    }

    Outcome look_up(const StoreView& view, StampNs stamp) {
        if (stale_)
            return Outcome::kFailed;
        return lookup::lookup(view, request_.target, request_.source, stamp, request_.policy,
                              space_.answer, space_.failure);
    }

    /// Computes the block's poses, and marks rows without one. False: overtaken.
    [[nodiscard]] bool evaluate(std::size_t count) {
        const std::size_t whole = geometry::round_up_to_group(count);
        const StampNs* const stamps = space_.stamps;
        std::fill(space_.stamps + count, space_.stamps + whole, stamps[count - 1]);
        const std::span<BatchEdge> all(space_.edges);
        const auto source_side = all.first(space_.source_edges);
        const auto target_side = all.subspan(space_.source_edges);
        geometry::PoseBlock& block = space_.block;
        if (all.empty())
            kernels_.join_constant(block, whole, geometry::identity(), true);
        if (!join_side(source_side, whole, block) ||
            !join_side(target_side, whole, source_side.empty() ? block : space_.target_block))
            return false;
        if (source_side.empty() && !target_side.empty())
            kernels_.turn(block, whole);
        else if (!target_side.empty())
            kernels_.meet(block, space_.target_block, whole);
        if (!kernels_.all_finite(block, whole)) {
            for (std::size_t i = 0; i < whole; ++i) {
                if (!geometry::is_finite(geometry::pose_at(block, i)))
                    space_.marks[i] = Mark::kSingle;
            }
        }
        return std::all_of(all.begin(), all.end(),
                           [](const BatchEdge& edge) { return edge.view().confirm(); });
    }

    [[nodiscard]] bool join_side(std::span<BatchEdge> side, std::size_t whole,
                                 geometry::PoseBlock& block) {
        geometry::Pairs& pairs = space_.pairs;
        const StampNs* const stamps = space_.stamps;
        bool first = true;
        for (BatchEdge& edge : side) {
            if (edge.is_static()) {
                kernels_.join_constant(block, whole, edge.pose(), first);
            } else {
                if (!edge.find(stamps, whole, request_.policy, pairs, space_.marks))
                    return false;
                if (pairs.count == 0)
                    continue;
                if (!kernels_.load(pairs, edge.words()))
                    edge.mark_strangers(pairs, whole, space_.marks);
                kernels_.join(block, whole, stamps, pairs, first);
            }
            first = false;
        }
        return true;
    }

    /// Looks up a stamp that the kernels could not answer. False: overtaken.
    [[nodiscard]] bool answer_single(const StoreView& view, std::size_t i, std::size_t row) {
        Mark& mark = space_.marks[i];
        const bool unsure = mark == Mark::kRefused && !request_.stop;
        if (unsure && !only_path_ && check_only_path(view) == Outcome::kLapped)
            return false;
        const bool earlier = refused_ && *refused_ < row;
        Outcome outcome = Outcome::kFailed;
        if (!earlier && !(unsure && *only_path_))
            outcome = look_up(view, space_.stamps[i]);
        mark = outcome == Outcome::kOk ? Mark::kPlain : Mark::kRefused;
        if (outcome == Outcome::kOk)
            geometry::put_pose(space_.block, i, space_.answer.pose);
        if (outcome == Outcome::kFailed && request_.stop)
            refused_ = std::min(row, refused_.value_or(row));
        missing_ |= outcome == Outcome::kFailed;
        return outcome != Outcome::kLapped;
    }

    /// Whether this path remains the only one if one of its edges refuses: each of its frames and
    /// their ancestors has one parent at all times, and none repeats. kLapped, or kOk.
    Outcome check_only_path(const StoreView& view) {
        std::vector<FrameId>& path = space_.path;
        only_path_ = true;
        for (std::size_t i = 0; i < path.size() && *only_path_; ++i) {
            StoreEdge edge;
            if (!view.open(path[i], edge))
                return Outcome::kLapped;
            const std::uint64_t newest = edge.empty() ? kNoFrame : edge.slot_word(edge.newest());
            const FrameId parent = history::SlotWord::parent(newest);
            if (!edge.confirm())
                return Outcome::kLapped;
            only_path_ = edge.one_parent();
            if (i + 1 == path.size() && parent != kNoFrame) {
                only_path_ =
                    *only_path_ && std::find(path.begin(), path.end(), parent) == path.end();
                path.push_back(parent);
            }
        }
        return Outcome::kOk;
    }

    const store::Store& store_;
    const Request& request_;
    Workspace& space_;
    Emit emit_;
    const geometry::Kernels& kernels_ = geometry::chosen_kernels();
    bool prepared_ = false;  // the path's edges are open, so that the kernels can read them
    bool missing_ = false;
    bool stale_ = false;  // `failure` then has the reason
    std::optional<std::size_t> refused_;
    std::optional<bool> only_path_;
};

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// Rows of points with separate or equal input and output.
template <class Real>
struct Points {
    geometry::PointRows<const Real> in;
    geometry::PointRows<Real> out;
    std::size_t count;

    void blank(std::size_t i) const { std::fill_n(out.from(i).data, 3, static_cast<Real>(kNone)); }
    void move_by_one(const geometry::Kernels& kernels, const Pose& pose) const {
        if constexpr (std::is_same_v<Real, double>)
            kernels.move_doubles_by_one(pose, count, in, out);
        else
            kernels.move_floats_by_one(pose, count, in, out);
    }
    void move(const geometry::Kernels& kernels, const geometry::PoseBlock& block) const {
        if constexpr (std::is_same_v<Real, double>)
            kernels.move_doubles(block, count, in, out);
        else
            kernels.move_floats(block, count, in, out);
    }
    /// Transforms the points of a block, each by its pose.
    void move(const geometry::Kernels& kernels, const Workspace& space, std::size_t begin,
              const Row* rows, std::size_t some) const {
        // rows gathered for their poses and scattered afterwards
        std::array<Real, 3 * kBlock> apart;
        if (rows == nullptr)
            Points{in.from(begin), out.from(begin), some}.move(kernels, space.block);
        for (std::size_t i = 0; i < some && rows != nullptr; ++i)
            std::copy_n(in.from(rows[i].index).data, 3, &apart[3 * i]);
        if (rows != nullptr)
            Points{{apart.data()}, {apart.data()}, some}.move(kernels, space.block);
        for (std::size_t i = 0; i < some; ++i) {
            const std::size_t row = rows == nullptr ? begin + i : rows[i].index;
            if (rows != nullptr)
                std::copy_n(&apart[3 * i], 3, out.from(row).data);
            if (space.marks[i] != Mark::kPlain)
                blank(row);
        }
    }
};

}  // namespace

/// Runs a batch on this reader's state, and throws the error of the first refused stamp.
/// `emit(space, begin, rows, count)`: see BatchRun.
template <class Emit>
void StoreReader::run_batch(FrameRef& target, FrameRef& source, std::span<const StampNs> stamps,
                            Policy policy, bool stop, Emit emit) const {
    const Lease lease;
    Workspace& space = *lease;
    Request request{kNoFrame, kNoFrame, stamps, policy, stop};
    BatchRun run(*store_, request, space, [&](auto... what) { emit(space, what...); });
    // Without a pin, writers that overtake a long batch would restart it.
    std::optional<store::ReadPin> pin;
    if (store_->engine == nullptr && stamps.size() > kBlock)
        pin.emplace(*store_);
    const bool found = store::read(*store_, held_, [&](const StoreView& view) {
        const auto find = [&](FrameRef& frame) {
            FrameHandle& known = frame.handle;
            if (known.id == kNoFrame || view.generation(known.id) != known.generation ||
                !view.alive(known.id))
                known = lookup::handle_of(view, store_->names.find(frame.name, view.commit()));
            return known.id;
        };
        request.target = find(target);
        request.source = find(source);
        return run(view);
    });
    if (found)
        return;
    try {
        raise(space.failure, store::by_name(Question::kAt, target.name, source.name));
    } catch (Error& error) {
        if (run.refused())
            error.detail().index = *run.refused();
        throw;
    }
}

void StoreReader::lookup_many(FrameRef& target, FrameRef& source, std::span<const StampNs> stamps,
                              Policy policy, Layout layout, Missing missing,
                              std::span<double> out) const {
    store::check_room(stamps, layout, out);
    const geometry::Kernels& kernels = geometry::chosen_kernels();
    const auto write = [&](auto width, auto store_rows) {
        constexpr std::size_t kWidth = decltype(width)::value;
        std::array<double, kWidth * kBlock> apart;  // rows to be scattered
        run_batch(
            target, source, stamps, policy, missing == Missing::kThrow,
            [&](const Workspace& space, std::size_t begin, const Row* rows, std::size_t count) {
                double* const to = rows == nullptr ? &out[kWidth * begin] : apart.data();
                store_rows(space.block, count, to);
                for (std::size_t i = 0; i < count; ++i) {
                    if (space.marks[i] != Mark::kPlain)
                        std::fill_n(to + kWidth * i, kWidth, kNone);
                    if (rows != nullptr)
                        std::copy_n(to + kWidth * i, kWidth, &out[kWidth * rows[i].index]);
                }
            });
    };
    if (layout == Layout::kPose)
        write(std::integral_constant<std::size_t, 7>{}, kernels.store_poses);
    else
        write(std::integral_constant<std::size_t, 16>{}, kernels.store_matrices);
}

template <class Real>
void StoreReader::transform_points(std::string_view target, std::string_view source,
                                   const Real* points, std::size_t stride, std::size_t count,
                                   std::span<const StampNs> stamps, Policy policy, Missing missing,
                                   Real* out, std::size_t out_stride) const {
    const bool one = stamps.size() == 1;
    store::check_points(points, stride, count, stamps, out, out_stride);
    const bool in_place = points == out && stride == out_stride;
    // Some stamp may have no answer, or the batch may restart: until then no point in place may
    // change.
    std::vector<Real> moved(in_place && !one ? 3 * count : 0);
    const geometry::PointRows<Real> rows{out, static_cast<std::ptrdiff_t>(out_stride)};
    const Points<Real> all{{points, static_cast<std::ptrdiff_t>(stride)},
                           moved.empty() ? rows : geometry::PointRows<Real>{moved.data()},
                           count};
    const geometry::Kernels& kernels = geometry::chosen_kernels();
    std::optional<Pose> pose;  // for all
    FrameRef into{.name = target};
    FrameRef from{.name = source};
    run_batch(into, from, stamps, policy, missing == Missing::kThrow,
              [&](const Workspace& space, std::size_t begin, const Row* order, std::size_t some) {
                  if (!one)
                      return all.move(kernels, space, begin, order, some);
                  pose.reset();
                  if (space.marks[0] == Mark::kPlain)
                      pose = geometry::pose_at(space.block, 0);
              });
    if (pose)
        all.move_by_one(kernels, *pose);
    for (std::size_t i = 0; i < count && one && !pose; ++i)
        all.blank(i);
    for (std::size_t i = 0; i < moved.size() / 3; ++i)
        std::copy_n(moved.data() + 3 * i, 3, rows.from(i).data);
}

template void StoreReader::transform_points(std::string_view, std::string_view, const float*,
                                            std::size_t, std::size_t, std::span<const StampNs>,
                                            Policy, Missing, float*, std::size_t) const;
template void StoreReader::transform_points(std::string_view, std::string_view, const double*,
                                            std::size_t, std::size_t, std::span<const StampNs>,
                                            Policy, Missing, double*, std::size_t) const;

std::vector<StampNs> StoreReader::path_stamps(std::string_view target, std::string_view source,
                                              std::optional<StampNs> start,
                                              std::optional<StampNs> end) const {
    std::vector<StampNs> stamps;
    Failure failure;
    const bool found = store::read(*store_, held_, [&](const StoreView& view) {
        const FrameId from = store_->names.find(source, view.commit());
        const FrameId to = store_->names.find(target, view.commit());
        return store::path_stamps(view, to, from, start, end, stamps, failure);
    });
    if (!found)
        raise(failure, store::by_name(Question::kCommonTime, target, source));
    return stamps;
}

}  // namespace tfdb
