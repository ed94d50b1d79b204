// Many stamps in one call: the windows of all edges are copied under one snapshot, then the
// kernels of geometry/batch.hpp run on plain memory.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "tfdb/geometry/batch.hpp"
#include "tfdb/store/collect.hpp"
#include "tfdb/store/impl.hpp"
#include "tfdb/store/rows.hpp"

namespace tfdb {

using lookup::Outcome;

namespace {

// Below this many samples per stamp copying the window is cheaper than single lookups (measured).
constexpr std::size_t kSamplesPerStamp = 16;
constexpr std::size_t kAlwaysCopied = 1024;

// So many stamps are looked up one by one before the work may be ended.
constexpr std::size_t kRowsBetween = 256;

// Up to here no path, however long, and no extrapolation makes a translation overflow: sums of 2^20
// edges times 2^62, the furthest that stamps can lie beyond two samples, stay below 1e308.
constexpr double kNoOverflow = 1e280;

struct Request {
    FrameId target;
    FrameId source;
    std::span<const StampNs> stamps;
    StampNs first = 0;
    StampNs last = 0;
    Policy policy;
};

/// Working memory of one thread, reused by its calls.
struct Workspace {
    std::vector<store::Track> tracks;
    std::vector<geometry::TrackView> views;  // the source's side, then the target's
    std::size_t source_edges = 0;
    geometry::BatchScratch scratch;
    std::vector<std::optional<Pose>> poses;
    Answer answer;
    Failure failure;

    [[nodiscard]] geometry::Path path() const {
        const std::span<const geometry::TrackView> all(views);
        return {all.first(source_edges), all.subspan(source_edges)};
    }
};

/// Those of one thread: who may end its work may ask for a batch of its own, amid another one.
/// Threads: one. Guarantee: wait-free but for the first of each depth.
struct Workspaces {
    std::vector<std::unique_ptr<Workspace>> all;
    std::size_t used = 0;

    static Workspaces& here() {
        thread_local Workspaces spaces;
        return spaces;
    }
};

/// Takes a workspace for its lifetime.
/// Threads: one. Guarantee: as Workspaces.
class Lease {
public:
    Lease() : spaces_(Workspaces::here()) {
        if (spaces_.used == spaces_.all.size())
            spaces_.all.push_back(std::make_unique<Workspace>());
        ++spaces_.used;
    }
    ~Lease() { --spaces_.used; }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;

private:
    Workspaces& spaces_;
};

/// The one that was taken last.
Workspace& workspace() {
    const Workspaces& spaces = Workspaces::here();
    return *spaces.all[spaces.used - 1];
}

geometry::Rule rule_of(const Policy& policy) {
    using geometry::Selection;
    switch (policy.kind) {
        case lookup::PolicyKind::kExact:
            return {Selection::kExact, policy.limit};
        case lookup::PolicyKind::kPrevious:
            return {Selection::kPrevious, policy.limit};
        case lookup::PolicyKind::kNearest:
            return {Selection::kNearest, policy.limit};
        case lookup::PolicyKind::kExtrapolate:
            return {Selection::kExtrapolate, policy.limit};
        default:
            break;
    }
    // No two stored stamps lie further apart: then the kernels need not look at the gaps.
    const bool any_gap = policy.limit >= lookup::kNoLimit;
    return {Selection::kInterpolate, any_gap ? geometry::kNoLimit : policy.limit};
}

/// Copies one edge. kMismatch if the path may be another one at some of the stamps, if its numbers
/// are so large that sums may overflow, or if too much would have to be copied: then every stamp is
/// looked up by itself.
Outcome copy_edge(const StoreView& view, FrameId child, FrameId parent, const Request& request,
                  store::Track& track) {
    const std::size_t most = std::max(kAlwaysCopied, kSamplesPerStamp * request.stamps.size());
    const Outcome outcome =
        store::collect_window(view, child, request.first, request.last, most, track);
    if (outcome == Outcome::kFailed)
        return Outcome::kMismatch;
    if (outcome != Outcome::kOk)
        return outcome;
    if (track.poses.empty())
        return Outcome::kMismatch;
    const CommitNumber oldest = *std::min_element(track.commits.begin(), track.commits.end());
    const bool same = std::all_of(track.parents.begin(), track.parents.end(),
                                  [&](FrameId id) { return id == parent; });
    const bool small = std::all_of(track.poses.begin(), track.poses.end(), [](const Pose& pose) {
        const geometry::Vec3& t = pose.translation;
        return std::fabs(t.x) + std::fabs(t.y) + std::fabs(t.z) < kNoOverflow;
    });
    return same && small && view.alive_since(parent, oldest) ? Outcome::kOk : Outcome::kMismatch;
}

Outcome copy_path(const StoreView& view, const Request& request, Workspace& space) {
    space.views.clear();
    const Outcome walked =
        lookup::walk(view, request.target, request.source, request.first, request.policy,
                     lookup::WalkMode::kHints, space.answer, space.failure);
    if (walked != Outcome::kOk)
        return walked;
    const auto& up = space.answer.source_chain;
    const auto& down = space.answer.target_chain;
    space.source_edges = up.size() - 1;
    const std::size_t edges = up.size() + down.size() - 2;
    if (space.tracks.size() < edges)
        space.tracks.resize(edges);
    for (const auto* chain : {&up, &down}) {
        for (std::size_t i = 0; i + 1 < chain->size(); ++i) {
            store::Track& track = space.tracks[space.views.size()];
            const Outcome outcome = copy_edge(view, (*chain)[i], (*chain)[i + 1], request, track);
            if (outcome != Outcome::kOk)
                return outcome;
            geometry::TrackView& copied = space.views.emplace_back();
            copied.stamps = track.stamps.data();
            copied.poses = track.poses.data();
            copied.size = track.poses.size();
            copied.is_static = track.is_static;
        }
    }
    return Outcome::kOk;
}

/// Whether the path that was copied is the only one also where an edge of it refuses: from the
/// meeting point upward each frame has one parent at all these stamps, and none is on the path.
/// Elsewhere the two frames may meet in another frame. kMismatch: perhaps not.
Outcome check_only_path(const StoreView& view, const Request& request, const Answer& walked) {
    const auto is_on = [](const std::vector<FrameId>& chain, FrameId id) {
        return std::find(chain.begin(), chain.end(), id) != chain.end();
    };
    FrameId id = walked.source_chain.back();
    store::Track track;
    for (std::uint32_t steps = 0; steps <= view.frame_count(); ++steps) {
        const Outcome outcome =
            store::collect_window(view, id, request.first, request.last, kAlwaysCopied, track);
        if (outcome != Outcome::kOk)
            return outcome == Outcome::kFailed ? Outcome::kMismatch : outcome;
        if (track.parents.empty())
            return Outcome::kOk;
        id = track.parents.front();
        const CommitNumber oldest = *std::min_element(track.commits.begin(), track.commits.end());
        const bool same = std::all_of(track.parents.begin(), track.parents.end(),
                                      [&](FrameId parent) { return parent == id; });
        if (!same || !view.alive_since(id, oldest) || is_on(walked.source_chain, id) ||
            is_on(walked.target_chain, id)) {
            return Outcome::kMismatch;
        }
    }
    return Outcome::kMismatch;
}

/// The caller's way to consume results: `kernel` runs on a copied path, and leaves NaN where an
/// edge refuses; `one` takes one pose (null: no answer, write NaN).
template <class Kernel, class One>
class BatchRun {
public:
    BatchRun(const Reads::Impl& impl, const Request& request, bool stop, Kernel kernel, One one)
        : impl_(impl), request_(request), stop_(stop), kernel_(kernel), one_(one) {}

    Outcome operator()(const StoreView& view) {
        Workspace& space = workspace();
        refused_ = geometry::kNoneRefused;
        if (!lookup::detail::check_frame(view, request_.target, 0, space.failure) ||
            !lookup::detail::check_frame(view, request_.source, 1, space.failure)) {
            return Outcome::kFailed;
        }
        if (request_.target == request_.source) {
            space.views.clear();
            space.source_edges = 0;
        } else {
            const Outcome copied = copy_path(view, request_, space);
            if (copied != Outcome::kOk)
                return copied == Outcome::kLapped ? copied : one_by_one(view, space);
        }
        const std::size_t refused = geometry::first_refused(space.path(), rule_of(request_.policy),
                                                            request_.stamps, space.scratch);
        if (refused != geometry::kNoneRefused) {
            const Outcome only = check_only_path(view, request_, space.answer);
            if (only != Outcome::kOk)
                return only == Outcome::kLapped ? only : one_by_one(view, space);
            if (stop_)
                return refuse(view, space, refused);
            if (reused(view))
                return Outcome::kLapped;
        }
        kernel_(space);
        return Outcome::kOk;
    }

    [[nodiscard]] std::size_t refused() const { return refused_; }

private:
    Outcome look_up(const StoreView& view, Workspace& space, std::size_t i) {
        return lookup::lookup(view, request_.target, request_.source, request_.stamps[i],
                              request_.policy, space.answer, space.failure);
    }
    /// What is missing may be a frame whose slot was reused since. Asked before anything is
    /// written: points may be moved in place, and only once.
    [[nodiscard]] bool reused(const StoreView& view) const {
        return store::unless_reused(impl_, view.commit(), Outcome::kOk) == Outcome::kLapped;
    }
    /// The lookup of one stamp says why.
    Outcome refuse(const StoreView& view, Workspace& space, std::size_t i) {
        refused_ = i;
        const Outcome why = look_up(view, space, i);
        return why == Outcome::kOk ? Outcome::kLapped : why;
    }

    /// All poses come first.
    Outcome one_by_one(const StoreView& view, Workspace& space) {
        space.poses.clear();
        bool missing = false;
        for (std::size_t i = 0; i < request_.stamps.size(); ++i) {
            if (i % kRowsBetween == 0)
                may_end();
            const Outcome outcome = look_up(view, space, i);
            if (outcome == Outcome::kLapped)
                return outcome;
            if (outcome == Outcome::kFailed && stop_) {
                refused_ = i;
                return outcome;
            }
            auto& pose = space.poses.emplace_back();
            if (outcome == Outcome::kOk)
                pose = space.answer.pose;
            missing |= !pose;
        }
        if (missing && reused(view))
            return Outcome::kLapped;
        for (std::size_t i = 0; i < space.poses.size(); ++i) {
            one_(i, space.poses[i] ? &*space.poses[i] : nullptr);
        }
        return Outcome::kOk;
    }

    const Reads::Impl& impl_;
    const Request& request_;
    bool stop_;
    Kernel kernel_;
    One one_;
    std::size_t refused_ = geometry::kNoneRefused;
};

template <class Real>
void move_point(const Pose* pose, const Real* in, Real* out) {
    if (pose == nullptr) {
        std::fill_n(out, 3, std::numeric_limits<Real>::quiet_NaN());
        return;
    }
    const geometry::Vec3 p = geometry::apply(*pose, {in[0], in[1], in[2]});
    out[0] = static_cast<Real>(p.x);
    out[1] = static_cast<Real>(p.y);
    out[2] = static_cast<Real>(p.z);
}

}  // namespace

/// Runs a batch on this reader's state, and throws what the first refused stamp says.
template <class Kernel, class One>
void Reads::run_batch(std::string_view target, std::string_view source,
                      std::span<const StampNs> stamps, Policy policy, bool stop, Kernel kernel,
                      One one) const {
    const Lease lease;
    Request request{kNoFrame, kNoFrame, stamps, 0, 0, policy};
    if (!stamps.empty()) {
        const auto [first, last] = std::minmax_element(stamps.begin(), stamps.end());
        request.first = *first;
        request.last = *last;
    }
    BatchRun run(*impl_, request, stop, kernel, one);
    const Outcome outcome = store::read(*impl_, held_, kFresh, [&](const StoreView& view) {
        request.target = impl_->names.find(target, view.commit());
        request.source = impl_->names.find(source, view.commit());
        return run(view);
    });
    if (outcome == Outcome::kOk)
        return;
    if (outcome == Outcome::kLapped)
        store::throw_snapshot_too_old(held_, impl_->committed());
    try {
        raise(workspace().failure, store::by_name(Question::kAt, target, source));
    } catch (Error& error) {
        if (run.refused() != geometry::kNoneRefused)
            error.detail().index = run.refused();
        throw;
    }
}

void Reads::lookup_many(std::string_view target, std::string_view source,
                        std::span<const StampNs> stamps, Policy policy, Layout layout,
                        Missing missing, std::span<double> out) const {
    store::check_room(stamps, layout, out);
    const auto rows =
        layout == Layout::kMatrix ? geometry::PoseLayout::kMatrix : geometry::PoseLayout::kPose;
    run_batch(
        target, source, stamps, policy, missing == Missing::kThrow,
        [&](Workspace& space) {
            geometry::evaluate_poses(space.path(), rule_of(policy), stamps, rows, out.data(),
                                     geometry::OnRefused::kNan, space.scratch);
        },
        [&](std::size_t i, const Pose* pose) {
            store::write_row(pose, layout, out.data() + store::row_width(layout) * i);
        });
}

template <class Real>
void Reads::move_points(std::string_view target, std::string_view source, const Real* points,
                        std::size_t stride, std::size_t count, std::span<const StampNs> stamps,
                        Policy policy, Missing missing, Real* out, std::size_t out_stride) const {
    if (stamps.size() != count && stamps.size() != 1) {
        throw InvalidArgument("transform_points takes one stamp for each of the " +
                              std::to_string(count) + " points or one for all, not " +
                              std::to_string(stamps.size()));
    }
    store::check_apart(store::bytes_of(stamps), store::bytes_of_rows(out, out_stride, count),
                       "the stamps");
    if (points != out || stride != out_stride) {
        store::check_apart(store::bytes_of_rows(points, stride, count),
                           store::bytes_of_rows(out, out_stride, count), "the points");
    }
    run_batch(
        target, source, stamps, policy, missing == Missing::kThrow,
        [&](Workspace& space) {
            geometry::transform_points(
                space.path(), rule_of(policy), stamps, count,
                geometry::PointRows<const Real>{points, static_cast<std::ptrdiff_t>(stride)},
                geometry::PointRows<Real>{out, static_cast<std::ptrdiff_t>(out_stride)},
                geometry::OnRefused::kNan, space.scratch);
        },
        [&](std::size_t i, const Pose* pose) {
            const std::size_t first = stamps.size() == 1 ? 0 : i;
            const std::size_t end = stamps.size() == 1 ? count : i + 1;
            for (std::size_t p = first; p < end; ++p) {
                move_point(pose, points + p * stride, out + p * out_stride);
            }
        });
}

void Reads::transform_points(std::string_view target, std::string_view source, const float* points,
                             std::size_t stride, std::size_t count, std::span<const StampNs> stamps,
                             Policy policy, Missing missing, float* out,
                             std::size_t out_stride) const {
    move_points(target, source, points, stride, count, stamps, policy, missing, out, out_stride);
}

void Reads::transform_points(std::string_view target, std::string_view source, const double* points,
                             std::size_t stride, std::size_t count, std::span<const StampNs> stamps,
                             Policy policy, Missing missing, double* out,
                             std::size_t out_stride) const {
    move_points(target, source, points, stride, count, stamps, policy, missing, out, out_stride);
}

std::vector<StampNs> Reads::path_stamps(std::string_view target, std::string_view source,
                                        std::optional<StampNs> start,
                                        std::optional<StampNs> end) const {
    const Lease lease;
    std::vector<StampNs> stamps;
    Workspace& space = workspace();
    const Outcome outcome = store::read(*impl_, held_, kFresh, [&](const StoreView& view) {
        stamps.clear();
        const FrameId from = impl_->names.find(source, view.commit());
        const FrameId to = impl_->names.find(target, view.commit());
        // Walks the newest tree, and leaves the chains in the answer.
        const Outcome walked =
            lookup::latest_common_path(view, to, from, space.answer, space.failure);
        if (walked != Outcome::kOk || from == to)
            return walked;
        const StampNs newest = space.answer.stamp;
        StampNs first = start.value_or(0);
        StampNs last = std::min(newest, end.value_or(newest));
        for (const auto* chain : {&space.answer.source_chain, &space.answer.target_chain}) {
            for (std::size_t i = 0; i + 1 < chain->size(); ++i) {
                may_end();
                store::Track track;
                const Outcome copied = store::collect_all(view, (*chain)[i], track);
                if (copied != Outcome::kOk)
                    return copied;
                if (track.poses.empty())
                    return Outcome::kLapped;  // the walk found a parent here: the slot was reused
                if (track.is_static)
                    continue;
                first = std::max(first, track.stamps.front());
                last = std::min(last, track.stamps.back());
                stamps.insert(stamps.end(), track.stamps.begin(), track.stamps.end());
            }
        }
        std::erase_if(stamps, [&](StampNs s) { return s < first || s > last; });
        return Outcome::kOk;
    });
    if (outcome == Outcome::kLapped)
        store::throw_snapshot_too_old(held_, impl_->committed());
    if (outcome == Outcome::kFailed)
        raise(space.failure, store::by_name(Question::kCommonTime, target, source));
    std::sort(stamps.begin(), stamps.end());
    stamps.erase(std::unique(stamps.begin(), stamps.end()), stamps.end());
    return stamps;
}

}  // namespace tfdb
