#include "tfdb/geometry/batch.hpp"

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <string_view>
#include <vector>

#include "tfdb/base/interruption.hpp"
#include "tfdb/geometry/batch_kernels.hpp"
#include "tfdb/geometry/locate.hpp"
#include "tfdb/geometry/select.hpp"

namespace tfdb::geometry {

namespace {

#if defined(__x86_64__)
/// TFDB_KERNELS=portable: for tests, and to compare machines.
bool portable_wanted() {
    static const bool wanted = [] {
        const char* const kernels = std::getenv("TFDB_KERNELS");
        return kernels != nullptr && std::string_view(kernels) == "portable";
    }();
    return wanted;
}
#endif

const Kernels& choose_kernels(KernelChoice choice) {
#if defined(__x86_64__)
    if (choice == KernelChoice::kBest && !portable_wanted() && __builtin_cpu_supports("avx2")) {
        return kAvx2Kernels;
    }
#else
    static_cast<void>(choice);
#endif
    return kPortableKernels;
}

/// A run of groups in one segment shorter than this costs more than it saves.
constexpr std::size_t kShortestRun = 16;

/// One step of a prepared side: a constant pose, or a track that moves.
struct Step {
    Pose constant;
    const TrackView* track;  // null for a constant
    bool plain;              // see is_plain
    std::size_t locator;     // index into State::locators
};

}  // namespace

struct BatchScratch::State {
    explicit State(KernelChoice choice) : kernels(choose_kernels(choice)) {}

    const Kernels& kernels;
    std::vector<Step> source_steps;
    std::vector<Step> target_steps;
    std::vector<const TrackView*> lone;  // moving tracks of one sample: constant, but may refuse
    std::vector<Locator> locators;       // kept from call to call for their tables
    std::size_t used_locators = 0;
    QueryRange queries;
    bool may_refuse = false;
    bool refuses_all = false;

    PoseBlock block;         // of the source's side, then of the whole path
    PoseBlock target_block;  // of the target's side
    StampNs stamps[kBlock];  // the last block's stamps, filled up to a whole group
    std::uint32_t index[kBlock];
    double weights[kBlock];
    std::uint8_t refused[kBlock];
};

namespace {

using State = BatchScratch::State;

// --- the path --------------------------------------------------------------------------------

/// Constants at the start of a side are composed beforehand, in the order of the walk. Behind an
/// edge that moves each stays by itself: composed with each other first, they would round
/// otherwise.
void add_constant(std::vector<Step>& steps, const Pose& pose) {
    if (steps.size() == 1 && steps.back().track == nullptr) {
        Pose& folded = steps.back().constant;
        folded = compose(pose, folded);
    } else {
        steps.push_back(Step{pose, nullptr, true, 0});
    }
}

void add_moving(State& state, std::vector<Step>& steps, const TrackView& track, const Rule& rule) {
    if (state.used_locators == state.locators.size()) {
        state.locators.emplace_back();
    }
    Locator& locator = state.locators[state.used_locators];
    locator.prepare(track.stamps, track.size, state.queries);
    const bool plain = is_plain(track, rule, state.queries, locator.low(), locator.high());
    state.may_refuse |= !plain;
    steps.push_back(Step{identity(), &track, plain, state.used_locators});
    ++state.used_locators;
}

void prepare_side(State& state, std::vector<Step>& steps, std::span<const TrackView> side,
                  const Rule& rule) {
    steps.clear();
    for (const TrackView& track : side) {
        if (!track.is_static && track.size == 0) {
            state.refuses_all = true;
            state.may_refuse = true;
        } else if (track.is_static || track.size == 1) {
            add_constant(steps, track.poses[0]);
            if (!track.is_static) {
                state.lone.push_back(&track);
                state.may_refuse = true;
            }
        } else {
            add_moving(state, steps, track, rule);
        }
    }
}

void prepare(State& state, const Path& path, const Rule& rule, std::span<const StampNs> stamps) {
    state.lone.clear();
    state.used_locators = 0;
    state.may_refuse = false;
    state.refuses_all = false;
    state.queries = describe(stamps);
    prepare_side(state, state.source_steps, path.source_side, rule);
    prepare_side(state, state.target_steps, path.target_side, rule);
    if (state.source_steps.empty() && state.target_steps.empty()) {
        state.source_steps.push_back(Step{identity(), nullptr, true, 0});
    }
}

void rewind(State& state) {
    for (std::size_t i = 0; i < state.used_locators; ++i) {
        state.locators[i].rewind();
    }
}

// --- one block -------------------------------------------------------------------------------

/// The stamps of a block, with the last one repeated up to a whole group.
const StampNs* padded(State& state, const StampNs* stamps, std::size_t count) {
    const std::size_t whole = round_up_to_group(count);
    if (whole == count) {
        return stamps;
    }
    std::copy_n(stamps, count, state.stamps);
    std::fill(state.stamps + count, state.stamps + whole, stamps[count - 1]);
    return state.stamps;
}

std::size_t mark_lone(State& state, const Rule& rule, const StampNs* stamps, std::size_t whole) {
    std::fill_n(state.index, whole, 0U);
    std::size_t refused = 0;
    for (const TrackView* track : state.lone) {
        refused +=
            select_block(*track, rule, stamps, state.index, whole, state.weights, state.refused)
                .refused;
    }
    return refused;
}

/// Marks the refused stamps of a block of which the poses are not wanted; true if there are any.
bool mark_refused(State& state, const Rule& rule, const StampNs* stamps, std::size_t count) {
    std::fill_n(state.refused, kBlock, static_cast<std::uint8_t>(state.refuses_all));
    if (state.refuses_all) {
        return true;
    }
    std::size_t refused = mark_lone(state, rule, stamps, count);
    for (const auto* steps : {&state.source_steps, &state.target_steps}) {
        for (const Step& step : *steps) {
            if (step.plain) {
                continue;
            }
            state.locators[step.locator].locate(stamps, count, state.index);
            refused += select_block(*step.track, rule, stamps, state.index, count, state.weights,
                                    state.refused)
                           .refused;
        }
    }
    return refused > 0;
}

/// Extrapolated stamps are rare: their blocks go through the scalar functions.
void join_scalar(const State& state, PoseBlock& b, const TrackView& track, const Rule& rule,
                 const StampNs* stamps, std::size_t count, bool first) {
    for (std::size_t i = 0; i < count; ++i) {
        const Selected selected = select_at(track, rule, stamps[i], state.index[i]);
        const Pose edge = pose_at(track, selected, stamps[i]);
        const Pose before{{b.x[i], b.y[i], b.z[i]}, {b.qx[i], b.qy[i], b.qz[i], b.qw[i]}};
        const Pose after = first ? edge : compose(edge, before);
        b.x[i] = after.translation.x;
        b.y[i] = after.translation.y;
        b.z[i] = after.translation.z;
        b.qx[i] = after.rotation.x;
        b.qy[i] = after.rotation.y;
        b.qz[i] = after.rotation.z;
        b.qw[i] = after.rotation.w;
    }
}

/// Sorted stamps: long runs inside one segment by their own kernel, the groups between by the
/// other. A group that crosses a sample is never part of a run.
void join_sorted(const State& state, PoseBlock& block, const Pose* poses, std::size_t whole,
                 bool first) {
    const Kernels& kernels = state.kernels;
    const std::uint32_t* index = state.index;
    std::size_t pending = 0;  // groups from here to `at` wait for the scattered kernel
    std::size_t at = 0;
    while (at + kShortestRun <= whole) {
        if (index[at] != index[at + kShortestRun - 1]) {
            at += kGroup;
            continue;
        }
        const auto past = static_cast<std::size_t>(
            std::upper_bound(index + at + kShortestRun, index + whole, index[at]) - index);
        const GroupRange run{at, past / kGroup * kGroup};
        kernels.join_run(block, run, poses + index[at], state.weights, first);
        kernels.join_scattered(block, {pending, at}, poses, index, state.weights, first);
        at = pending = run.end;
    }
    kernels.join_scattered(block, {pending, whole}, poses, index, state.weights, first);
}

void join_moving(State& state, PoseBlock& block, const Step& step, const Rule& rule,
                 const StampNs* stamps, std::size_t whole, bool first) {
    const TrackView& track = *step.track;
    state.locators[step.locator].locate(stamps, whole, state.index);
    if (step.plain) {
        state.kernels.weigh(track.stamps, stamps, state.index, whole, state.weights);
    } else {
        const BlockSelection selected =
            select_block(track, rule, stamps, state.index, whole, state.weights, state.refused);
        if (selected.outside) {
            join_scalar(state, block, track, rule, stamps, whole, first);
            return;
        }
    }
    if (state.queries.sorted && step.plain) {
        join_sorted(state, block, track.poses, whole, first);
    } else {
        state.kernels.join_scattered(block, {0, whole}, track.poses, state.index, state.weights,
                                     first);
    }
}

void join_side(State& state, PoseBlock& block, const std::vector<Step>& steps, const Rule& rule,
               const StampNs* stamps, std::size_t whole) {
    bool first = true;
    for (const Step& step : steps) {
        if (step.track == nullptr) {
            state.kernels.join_constant(block, whole, step.constant, first);
        } else {
            join_moving(state, block, step, rule, stamps, whole, first);
        }
        first = false;
    }
}

/// Poses of T[target<-source] into state.block, refused stamps marked in state.refused.
void evaluate_block(State& state, const Rule& rule, const StampNs* block_stamps,
                    std::size_t count) {
    const StampNs* stamps = padded(state, block_stamps, count);
    const std::size_t whole = round_up_to_group(count);
    if (state.may_refuse) {
        std::fill_n(state.refused, kBlock, static_cast<std::uint8_t>(state.refuses_all));
        mark_lone(state, rule, stamps, whole);
    }
    if (state.target_steps.empty()) {
        join_side(state, state.block, state.source_steps, rule, stamps, whole);
    } else if (state.source_steps.empty()) {
        join_side(state, state.block, state.target_steps, rule, stamps, whole);
        state.kernels.turn(state.block, whole);
    } else {
        join_side(state, state.block, state.source_steps, rule, stamps, whole);
        join_side(state, state.target_block, state.target_steps, rule, stamps, whole);
        state.kernels.meet(state.block, state.target_block, whole);
    }
}

// --- whole calls -----------------------------------------------------------------------------

std::size_t find_first_refused(State& state, const Rule& rule, std::span<const StampNs> stamps) {
    if (!state.may_refuse) {
        return kNoneRefused;
    }
    for (std::size_t begin = 0; begin < stamps.size(); begin += kBlock) {
        may_end();
        const std::size_t count = std::min(kBlock, stamps.size() - begin);
        if (mark_refused(state, rule, stamps.data() + begin, count)) {
            const std::uint8_t* found = std::find(state.refused, state.refused + count, 1);
            return begin + static_cast<std::size_t>(found - state.refused);
        }
    }
    rewind(state);
    return kNoneRefused;
}

/// Calls emit(begin, count) for each block of evaluated poses and blank(i) for refused stamps.
template <class Emit, class Blank>
BatchResult for_blocks(const Path& path, const Rule& rule, std::span<const StampNs> stamps,
                       OnRefused on_refused, State& state, Emit emit, Blank blank) {
    BatchResult result;
    if (stamps.empty()) {
        return result;
    }
    prepare(state, path, rule, stamps);
    if (on_refused == OnRefused::kStop) {
        result.first_refused = find_first_refused(state, rule, stamps);
        if (result.first_refused != kNoneRefused) {
            result.refused = 1;
            return result;
        }
    }
    for (std::size_t begin = 0; begin < stamps.size(); begin += kBlock) {
        may_end();
        const std::size_t count = std::min(kBlock, stamps.size() - begin);
        evaluate_block(state, rule, stamps.data() + begin, count);
        emit(begin, count);
        for (std::size_t i = 0; state.may_refuse && i < count; ++i) {
            if (state.refused[i] != 0) {
                blank(begin + i);
                result.first_refused = std::min(result.first_refused, begin + i);
                ++result.refused;
            }
        }
    }
    return result;
}

template <class Number>
Number* row_of(PointRows<Number> rows, std::size_t i) {
    return rows.data + static_cast<std::ptrdiff_t>(i) * rows.stride;
}

template <class Number>
void move_by_one(const Kernels& kernels, const Pose& pose, std::size_t count,
                 PointRows<const Number> in, PointRows<Number> out) {
    if constexpr (sizeof(Number) == sizeof(double)) {
        kernels.move_doubles_by_one(pose, count, in, out);
    } else {
        kernels.move_floats_by_one(pose, count, in, out);
    }
}

template <class Number>
void blank_point(PointRows<Number> out, std::size_t i) {
    std::fill_n(row_of(out, i), 3, std::numeric_limits<Number>::quiet_NaN());
}

template <class Number>
BatchResult transform_points_of(const Path& path, const Rule& rule, std::span<const StampNs> stamps,
                                std::size_t count, PointRows<const Number> in,
                                PointRows<Number> out, OnRefused on_refused, State& state) {
    const Kernels& kernels = state.kernels;
    if (stamps.size() == 1 && count != 1) {
        double row[7] = {};
        const auto emit = [&](std::size_t, std::size_t) {
            kernels.store_poses(state.block, 1, row);
        };
        BatchResult result =
            for_blocks(path, rule, stamps, on_refused, state, emit, [](std::size_t) {});
        if (result.refused == 0) {
            const Pose pose{{row[0], row[1], row[2]}, {row[3], row[4], row[5], row[6]}};
            move_by_one(kernels, pose, count, in, out);
        } else if (on_refused == OnRefused::kNan) {
            for (std::size_t i = 0; i < count; ++i) {
                blank_point(out, i);
            }
            result.refused = count;
        }
        return result;
    }
    const auto emit = [&](std::size_t begin, std::size_t rows) {
        const PointRows<const Number> from{row_of(in, begin), in.stride};
        const PointRows<Number> to{row_of(out, begin), out.stride};
        if constexpr (sizeof(Number) == sizeof(double)) {
            kernels.move_doubles(state.block, rows, from, to);
        } else {
            kernels.move_floats(state.block, rows, from, to);
        }
    };
    return for_blocks(path, rule, stamps.first(count), on_refused, state, emit,
                      [&](std::size_t i) { blank_point(out, i); });
}

}  // namespace

BatchScratch::BatchScratch(KernelChoice choice) : state_(std::make_unique<State>(choice)) {}
BatchScratch::~BatchScratch() = default;
BatchScratch::BatchScratch(BatchScratch&&) noexcept = default;
BatchScratch& BatchScratch::operator=(BatchScratch&&) noexcept = default;

const char* BatchScratch::kernel_name() const noexcept {
    return state_->kernels.name;
}

BatchResult evaluate_poses(const Path& path, const Rule& rule, std::span<const StampNs> stamps,
                           PoseLayout layout, double* out, OnRefused on_refused,
                           BatchScratch& scratch) {
    State& state = scratch.state();
    const bool poses = layout == PoseLayout::kPose;
    const std::size_t width = poses ? 7 : 16;
    const auto store = poses ? state.kernels.store_poses : state.kernels.store_matrices;
    return for_blocks(
        path, rule, stamps, on_refused, state,
        [&](std::size_t begin, std::size_t count) {
            store(state.block, count, out + width * begin);
        },
        [&](std::size_t i) {
            std::fill_n(out + width * i, width, std::numeric_limits<double>::quiet_NaN());
        });
}

BatchResult transform_points(const Path& path, const Rule& rule, std::span<const StampNs> stamps,
                             std::size_t count, PointRows<const double> in, PointRows<double> out,
                             OnRefused on_refused, BatchScratch& scratch) {
    return transform_points_of(path, rule, stamps, count, in, out, on_refused, scratch.state());
}

BatchResult transform_points(const Path& path, const Rule& rule, std::span<const StampNs> stamps,
                             std::size_t count, PointRows<const float> in, PointRows<float> out,
                             OnRefused on_refused, BatchScratch& scratch) {
    return transform_points_of(path, rule, stamps, count, in, out, on_refused, scratch.state());
}

void transform_points(const Pose& pose, std::size_t count, PointRows<const double> in,
                      PointRows<double> out, BatchScratch& scratch) {
    move_by_one(scratch.state().kernels, pose, count, in, out);
}

void transform_points(const Pose& pose, std::size_t count, PointRows<const float> in,
                      PointRows<float> out, BatchScratch& scratch) {
    move_by_one(scratch.state().kernels, pose, count, in, out);
}

std::size_t first_refused(const Path& path, const Rule& rule, std::span<const StampNs> stamps,
                          BatchScratch& scratch) {
    if (stamps.empty()) {
        return kNoneRefused;
    }
    prepare(scratch.state(), path, rule, stamps);
    return find_first_refused(scratch.state(), rule, stamps);
}

}  // namespace tfdb::geometry
