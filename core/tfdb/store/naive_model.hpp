// A simple model of the whole store: a list of samples per frame, and a linear search for every
// question. For tests only: it checks the store's answers.
#pragma once

#include <algorithm>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/geometry/slerp.hpp"
#include "tfdb/lookup/answer.hpp"
#include "tfdb/lookup/policy.hpp"
#include "tfdb/store/buffer.hpp"

namespace tfdb::naive {

using clock::StampNs;
using geometry::Pose;
using lookup::Policy;
using lookup::PolicyKind;
using lookup::Used;

struct Member {
    std::string parent;
    std::string child;
    StampNs stamp;
    Pose pose;
};

/// The samples used on one edge of a path; stamps are -1 for a static edge.
struct Use {
    std::string child, parent;
    Used used;
    StampNs before, after;
    bool inverted;
    friend bool operator==(const Use&, const Use&) = default;
};

struct Reply {
    std::optional<ErrorCode> error;
    ErrorDetail detail;  // the expected fields of a lookup's error
    Pose pose = geometry::identity();
    StampNs stamp = 0;
    std::vector<Use> edges;
};

/// All commits of a store, and the answers in any of its states.
/// Threads: one. Guarantee: slow and simple.
class Model {
public:
    explicit Model(std::optional<StampNs> history) : history_(history) {}

    [[nodiscard]] std::size_t commit() const { return commit_; }
    /// The faults of single members of the batch, by index. Rejected members do not occupy a stamp.
    [[nodiscard]] std::map<std::size_t, ErrorCode> faults(
        const std::vector<Member>& batch, bool is_static, WriteRules rules = {},
        const std::set<std::size_t>& left_out = {}) const;
    /// Whether these valid members would close a cycle together.
    [[nodiscard]] bool closes_cycle(const std::vector<Member>& batch, bool is_static) const;
    void set(const std::vector<Member>& batch, bool is_static);
    std::optional<ErrorCode> remove(const std::string& name, bool recursive);
    void clear();

    [[nodiscard]] std::vector<std::string> frames(std::size_t state) const;
    [[nodiscard]] Reply lookup(std::size_t state, const std::string& target,
                               const std::string& source, std::optional<StampNs> stamp,
                               Policy policy) const;
    /// Each edge's newest sample, if none is older than now - max_age.
    [[nodiscard]] Reply lookup_latest(std::size_t state, const std::string& target,
                                      const std::string& source, std::optional<StampNs> max_age,
                                      StampNs now) const;
    /// T[target at its stamp <- source at its stamp], through a frame that does not move.
    [[nodiscard]] Reply lookup_full(std::size_t state, const std::string& target,
                                    std::optional<StampNs> target_stamp, const std::string& source,
                                    std::optional<StampNs> source_stamp, const std::string& fixed,
                                    Policy policy) const;
    /// Without the authority and the late count.
    [[nodiscard]] FrameInfo info(std::size_t state, const std::string& name) const;
    [[nodiscard]] tfdb::Samples samples(std::size_t state, const std::string& name) const;

    /// The oldest and the newest stamp that the newest tree's path covers; empty without a path.
    [[nodiscard]] std::optional<std::pair<StampNs, StampNs>> common_times(
        std::size_t state, const std::string& target, const std::string& source) const;
    /// An empty string for a root; none for an unknown frame. Without `stamp`: the newest sample's
    /// parent.
    [[nodiscard]] std::optional<std::string> parent_of(std::size_t state, const std::string& name,
                                                       std::optional<StampNs> stamp) const;

    /// Computes every frame in every state now: questions then change nothing until the next write.
    void remember() const {
        for (std::size_t frame = 0; frame < frames_.size(); ++frame) {
            for (std::size_t state = 0; state <= commit_; ++state) {
                (void)visible(static_cast<int>(frame), state);
            }
        }
    }

private:
    static constexpr int kNone = -1;
    static constexpr std::size_t kAlive = ~std::size_t{0};

    struct Frame {
        std::string name;
        std::size_t born;
        std::size_t died = kAlive;
    };
    struct Sample {
        int parent;
        StampNs stamp;
        Pose pose;
        std::size_t commit;
        bool is_static;
    };
    using Samples = std::vector<const Sample*>;
    struct Choice {
        const Sample* anchor = nullptr;
        const Sample* second = nullptr;
        Used used = Used::kStatic;
        std::optional<ErrorCode> refused;
        std::optional<std::pair<StampNs, StampNs>> bracket;  // of two samples
    };

    [[nodiscard]] const std::string& name_of(int frame) const {
        return frames_[static_cast<std::size_t>(frame)].name;
    }
    static Reply unknown(const std::string& name) {
        Reply reply;
        reply.error = ErrorCode::kUnknownFrame;
        reply.detail.frame = name;
        return reply;
    }
    [[nodiscard]] bool alive(int frame, std::size_t state) const {
        const Frame& f = frames_[static_cast<std::size_t>(frame)];
        return f.born <= state && state < f.died;
    }
    [[nodiscard]] int find(const std::string& name, std::size_t state) const;
    int find_or_make(const std::string& name);
    [[nodiscard]] const Samples& visible(int frame, std::size_t state) const;
    [[nodiscard]] Samples look_for_visible(int frame, std::size_t state) const;
    [[nodiscard]] Choice choose(int frame, StampNs stamp, Policy policy, std::size_t state) const;
    [[nodiscard]] int parent_at(int frame, StampNs stamp, Policy policy, std::size_t state,
                                bool answering = false) const;
    [[nodiscard]] int held_parent(const Samples& samples, StampNs stamp, std::size_t state) const;
    [[nodiscard]] bool has_cycle(std::size_t state) const;
    [[nodiscard]] std::optional<ErrorCode> fault_of_edge(const Member& m, bool is_static,
                                                         WriteRules rules) const;
    [[nodiscard]] std::vector<int> chain(int frame, StampNs stamp, Policy policy, std::size_t state,
                                         bool answering = false) const;
    [[nodiscard]] std::optional<ErrorCode> climb(const std::vector<int>& chain, int top,
                                                 StampNs stamp, Policy policy, std::size_t state,
                                                 bool inverted, Reply& reply, Pose& pose) const;
    [[nodiscard]] Use use_of(int frame, const Choice& choice, bool inverted) const;
    [[nodiscard]] ErrorDetail error_detail(int frame, const Choice& choice, StampNs stamp,
                                           Policy policy, std::size_t state) const;
    [[nodiscard]] static int meet(const std::vector<int>& a, const std::vector<int>& b);
    [[nodiscard]] std::optional<StampNs> common_time(std::size_t state, int target,
                                                     int source) const;
    [[nodiscard]] static Pose pose_of(const Choice& choice, StampNs stamp);
    [[nodiscard]] static Choice choose_outside(const Samples& samples, StampNs stamp, Policy policy,
                                               bool future);

    std::optional<StampNs> history_;
    std::size_t commit_ = 0;
    std::vector<Frame> frames_;
    std::vector<std::deque<Sample>> samples_;  // by child, in order of arrival
    std::vector<std::size_t> clears_;
    // The results of `visible` since the last write.
    mutable std::map<std::pair<int, std::size_t>, Samples> seen_;
};

inline int Model::find(const std::string& name, std::size_t state) const {
    for (std::size_t i = 0; i < frames_.size(); ++i) {
        if (frames_[i].name == name && alive(static_cast<int>(i), state)) {
            return static_cast<int>(i);
        }
    }
    return kNone;
}

inline int Model::find_or_make(const std::string& name) {
    const int found = find(name, commit_ + 1);
    if (found != kNone)
        return found;
    frames_.push_back({name, commit_ + 1});
    return static_cast<int>(frames_.size()) - 1;
}

/// In stamp order, one sample per stamp; a static edge has only its newest pose.
inline const Model::Samples& Model::visible(int frame, std::size_t state) const {
    const auto [at, asked] = seen_.try_emplace({frame, state});
    if (asked)
        at->second = look_for_visible(frame, state);
    return at->second;
}

inline Model::Samples Model::look_for_visible(int frame, std::size_t state) const {
    std::size_t cleared = 0;
    for (const std::size_t c : clears_) {
        if (c <= state)
            cleared = c;
    }
    std::map<StampNs, const Sample*> by_stamp;
    if (static_cast<std::size_t>(frame) >= samples_.size())
        return {};
    for (const Sample& s : samples_[static_cast<std::size_t>(frame)]) {
        if (s.commit > state)
            break;
        // An edge that changes its kind starts empty.
        if (!by_stamp.empty() && by_stamp.begin()->second->is_static != s.is_static)
            by_stamp.clear();
        if (s.is_static) {
            by_stamp[0] = &s;
        } else if (s.commit > cleared) {
            by_stamp[s.stamp] = &s;
        }
    }
    Samples found;
    for (const auto& [stamp, sample] : by_stamp) {
        if (sample->is_static || !history_ || stamp >= by_stamp.rbegin()->first - *history_) {
            found.push_back(sample);
        }
    }
    return found;
}

inline Model::Choice Model::choose_outside(const Samples& samples, StampNs stamp, Policy policy,
                                           bool future) {
    Choice c;
    c.anchor = future ? samples.back() : samples.front();
    const StampNs beyond = future ? stamp - c.anchor->stamp : c.anchor->stamp - stamp;
    if (policy.kind == PolicyKind::kExact) {
        c.refused = ErrorCode::kNoSampleNear;
    } else if (policy.kind == PolicyKind::kPrevious && future) {
        c.used = Used::kHeld;
        if (beyond > policy.limit)
            c.refused = ErrorCode::kStale;
    } else if (policy.kind == PolicyKind::kExtrapolate && beyond <= policy.limit) {
        c.used = Used::kExtrapolated;
        if (samples.size() > 1) {
            c.second = future ? samples[samples.size() - 2] : samples[1];
            c.bracket = std::minmax(c.anchor->stamp, c.second->stamp);
            if (c.second->parent != c.anchor->parent)
                c.second = nullptr;
        }
    } else {
        c.refused = ErrorCode::kExtrapolation;
    }
    return c;
}

inline Model::Choice Model::choose(int frame, StampNs stamp, Policy policy,
                                   std::size_t state) const {
    const Samples& samples = visible(frame, state);
    Choice c;
    if (samples.empty())
        return c;
    c.anchor = samples.back();
    if (c.anchor->is_static)
        return c;
    if (policy.kind == PolicyKind::kLatest) {
        c.used = Used::kLatest;
        return c;
    }
    const auto later = std::upper_bound(samples.begin(), samples.end(), stamp,
                                        [](StampNs t, const Sample* s) { return t < s->stamp; });
    const Sample* after = later == samples.end() ? nullptr : *later;
    const Sample* before = later == samples.begin() ? nullptr : *(later - 1);
    if (before != nullptr && before->stamp == stamp) {
        c.anchor = before;
        c.used = Used::kExact;
        return c;
    }
    if (policy.kind == PolicyKind::kNearest) {
        const bool take_later =
            before == nullptr || (after != nullptr && after->stamp - stamp < stamp - before->stamp);
        c.anchor = take_later ? after : before;
        c.used = Used::kNearest;
        if (std::abs(c.anchor->stamp - stamp) > policy.limit)
            c.refused = ErrorCode::kNoSampleNear;
        return c;
    }
    if (before == nullptr || after == nullptr) {
        return choose_outside(samples, stamp, policy, after == nullptr);
    }
    c.anchor = before;
    c.used = Used::kHeld;
    if (policy.kind == PolicyKind::kExact)
        c.refused = ErrorCode::kNoSampleNear;
    if (policy.kind == PolicyKind::kPrevious && stamp - before->stamp > policy.limit) {
        c.refused = ErrorCode::kStale;
    }
    if (policy.kind == PolicyKind::kInterpolate && after->stamp - before->stamp > policy.limit) {
        c.refused = ErrorCode::kGapTooLarge;
    }
    const bool mixes =
        policy.kind == PolicyKind::kInterpolate || policy.kind == PolicyKind::kExtrapolate;
    if (mixes)
        c.bracket = {before->stamp, after->stamp};
    if (mixes && before->parent == after->parent) {
        c.second = after;
        c.used = Used::kInterpolated;
    }
    return c;
}

inline Pose Model::pose_of(const Choice& c, StampNs stamp) {
    if (c.second == nullptr)
        return c.anchor->pose;
    const double u = static_cast<double>(stamp - c.anchor->stamp) /
                     static_cast<double>(c.second->stamp - c.anchor->stamp);
    return geometry::interpolate(c.anchor->pose, c.second->pose, u);
}

inline int Model::parent_at(int frame, StampNs stamp, Policy policy, std::size_t state,
                            bool answering) const {
    const Choice c = choose(frame, stamp, policy, state);
    if (answering && c.refused)
        return kNone;
    if (c.anchor == nullptr || !alive(c.anchor->parent, state))
        return kNone;
    return c.anchor->parent;
}

inline std::vector<int> Model::chain(int frame, StampNs stamp, Policy policy, std::size_t state,
                                     bool answering) const {
    std::vector<int> found;
    for (int at = frame; at != kNone; at = parent_at(at, stamp, policy, state, answering)) {
        const auto again = std::find(found.begin(), found.end(), at);
        if (again != found.end()) {  // in a cycle a frame with a later sample is a root
            const auto root = std::find_if(again, found.end(), [&](int f) {
                const Choice c = choose(f, stamp, policy, state);
                return !c.anchor->is_static && c.anchor->stamp > stamp;
            });
            found.erase(root == found.end() ? root : root + 1, found.end());
            break;
        }
        found.push_back(at);
    }
    return found;
}

inline std::optional<ErrorCode> Model::climb(const std::vector<int>& chain, int top, StampNs stamp,
                                             Policy policy, std::size_t state, bool inverted,
                                             Reply& reply, Pose& pose) const {
    pose = geometry::identity();
    for (const int at : chain) {
        if (at == top)
            break;
        const Choice c = choose(at, stamp, policy, state);
        if (c.refused) {
            reply.detail = error_detail(at, c, stamp, policy, state);
            return c.refused;
        }
        reply.edges.push_back(use_of(at, c, inverted));
        pose = geometry::compose(pose_of(c, stamp), pose);
        if (policy.kind == PolicyKind::kLatest && !c.anchor->is_static) {
            reply.stamp =
                reply.stamp < 0 ? c.anchor->stamp : std::min(reply.stamp, c.anchor->stamp);
        }
    }
    return std::nullopt;
}

inline Use Model::use_of(int frame, const Choice& c, bool inverted) const {
    Use use{name_of(frame), name_of(c.anchor->parent), c.used, -1, -1, inverted};
    if (!c.anchor->is_static)
        std::tie(use.before, use.after) =
            c.bracket.value_or(std::pair{c.anchor->stamp, c.anchor->stamp});
    return use;
}

inline ErrorDetail Model::error_detail(int frame, const Choice& c, StampNs stamp, Policy policy,
                                       std::size_t state) const {
    const Samples& samples = visible(frame, state);
    const auto later = std::upper_bound(samples.begin(), samples.end(), stamp,
                                        [](StampNs t, const Sample* s) { return t < s->stamp; });
    ErrorDetail detail;
    detail.edge = name_of(frame);
    detail.parent = name_of(c.anchor->parent);
    detail.stamp = stamp;
    detail.oldest = samples.front()->stamp;
    detail.newest = samples.back()->stamp;
    if (later != samples.begin())
        detail.before = (*(later - 1))->stamp;
    if (later != samples.end())
        detail.after = (*later)->stamp;
    if (policy.kind == PolicyKind::kExact) {
        detail.limit = 0;
    } else if (policy.limit != lookup::kNoLimit) {
        detail.limit = policy.limit;
    }
    if (c.refused == ErrorCode::kExtrapolation)
        detail.reason = stamp < samples.front()->stamp ? "past" : "future";
    return detail;
}

/// The first frame of `a` that is also in `b`.
inline int Model::meet(const std::vector<int>& a, const std::vector<int>& b) {
    for (const int x : a) {
        if (std::find(b.begin(), b.end(), x) != b.end())
            return x;
    }
    return kNone;
}

/// The latest common time; none if the frames are in two trees.
inline std::optional<StampNs> Model::common_time(std::size_t state, int target, int source) const {
    const Policy newest{PolicyKind::kLatest, 0};
    if (source == target) {
        const Choice own = choose(source, 0, newest, state);
        return own.anchor == nullptr || own.anchor->is_static ? 0 : own.anchor->stamp;
    }
    const auto up = chain(source, 0, newest, state);
    const auto down = chain(target, 0, newest, state);
    const int top = meet(up, down);
    if (top == kNone)
        return std::nullopt;
    Reply scratch;
    scratch.stamp = -1;
    Pose unused;
    (void)climb(up, top, 0, newest, state, false, scratch, unused);
    (void)climb(down, top, 0, newest, state, true, scratch, unused);
    return std::max<StampNs>(0, scratch.stamp);
}

inline std::optional<std::pair<StampNs, StampNs>> Model::common_times(
    std::size_t state, const std::string& target, const std::string& source) const {
    const int t = find(target, state);
    const int s = find(source, state);
    if (t == kNone || s == kNone)
        return std::nullopt;
    const auto newest = common_time(state, t, s);
    if (!newest)
        return std::nullopt;
    if (s == t) {
        const auto own = visible(s, state);
        const bool moves = !own.empty() && !own.front()->is_static;
        return std::pair{moves ? own.front()->stamp : StampNs{0}, *newest};
    }
    const Policy latest{PolicyKind::kLatest, 0};
    const auto up = chain(s, 0, latest, state);
    const auto down = chain(t, 0, latest, state);
    const int top = meet(up, down);
    std::vector<int> on_path(up.begin(), std::find(up.begin(), up.end(), top));
    on_path.insert(on_path.end(), down.begin(), std::find(down.begin(), down.end(), top));
    StampNs oldest = 0;
    for (const int frame : on_path) {
        const auto samples = visible(frame, state);
        auto first = samples.rbegin();
        while (first != samples.rend() && !(*first)->is_static &&
               (*first)->parent == samples.back()->parent) {
            oldest = first + 1 == samples.rend() || (*(first + 1))->parent != (*first)->parent
                         ? std::max(oldest, (*first)->stamp)
                         : oldest;
            ++first;
        }
    }
    return std::pair{oldest, *newest};
}

inline std::optional<std::string> Model::parent_of(std::size_t state, const std::string& name,
                                                   std::optional<StampNs> stamp) const {
    const int frame = find(name, state);
    if (frame == kNone)
        return std::nullopt;
    const Policy policy{stamp ? PolicyKind::kInterpolate : PolicyKind::kLatest, lookup::kNoLimit};
    const std::vector<int> up = chain(frame, stamp.value_or(0), policy, state);
    return up.size() < 2 ? std::string() : name_of(up[1]);
}

inline Reply Model::lookup(std::size_t state, const std::string& target, const std::string& source,
                           std::optional<StampNs> stamp, Policy policy) const {
    Reply reply;
    const int t = find(target, state);
    const int s = find(source, state);
    if (t == kNone || s == kNone)
        return unknown(t == kNone ? target : source);
    const bool latest = policy.kind == PolicyKind::kLatest;
    if (!stamp && !latest) {
        stamp = common_time(state, t, s);
        if (!stamp)
            policy = {PolicyKind::kLatest, 0};  // kLatest finds the frames in two trees
    }
    reply.stamp = latest ? -1 : stamp.value_or(-1);
    const StampNs at = stamp.value_or(0);
    auto up = chain(s, at, policy, state, true);
    auto down = chain(t, at, policy, state, true);
    if (meet(up, down) == kNone) {
        up = chain(s, at, policy, state);
        down = chain(t, at, policy, state);
    }
    const int top = meet(up, down);
    if (top == kNone) {
        reply.error = ErrorCode::kDisconnected;
        reply.detail.frames = {name_of(down.back()), name_of(up.back())};
        return reply;
    }
    Pose from_source = geometry::identity();
    Pose from_target = geometry::identity();
    reply.error = climb(up, top, at, policy, state, false, reply, from_source);
    if (!reply.error)
        reply.error = climb(down, top, at, policy, state, true, reply, from_target);
    if (reply.error)
        return reply;
    reply.pose = geometry::compose(geometry::inverse(from_target), from_source);
    if (reply.stamp < 0)
        reply.stamp = 0;
    return reply;
}

inline Reply Model::lookup_latest(std::size_t state, const std::string& target,
                                  const std::string& source, std::optional<StampNs> max_age,
                                  StampNs now) const {
    Reply reply = lookup(state, target, source, std::nullopt, {PolicyKind::kLatest, 0});
    for (const Use& use : reply.edges) {
        if (!reply.error && max_age && use.before >= 0 && use.before < now - *max_age) {
            reply.error = ErrorCode::kStale;
            reply.detail.edge = use.child;
            reply.detail.parent = use.parent;
            reply.detail.stamp = now;
            reply.detail.newest = use.before;
            reply.detail.limit = max_age;
        }
    }
    return reply;
}

inline Reply Model::lookup_full(std::size_t state, const std::string& target,
                                std::optional<StampNs> target_stamp, const std::string& source,
                                std::optional<StampNs> source_stamp, const std::string& fixed,
                                Policy policy) const {
    for (const std::string& name : {target, source, fixed}) {
        if (find(name, state) == kNone)
            return unknown(name);
    }
    const Reply first = lookup(state, fixed, source, source_stamp, policy);
    Reply second = lookup(state, target, fixed, target_stamp, policy);
    if (first.error || second.error)
        return first.error ? first : second;
    second.pose = geometry::compose(second.pose, first.pose);
    second.edges.insert(second.edges.begin(), first.edges.begin(), first.edges.end());
    return second;
}

inline tfdb::Samples Model::samples(std::size_t state, const std::string& name) const {
    tfdb::Samples found;
    for (const Sample* s : visible(find(name, state), state)) {
        found.stamps.push_back(s->is_static ? -1 : s->stamp);
        found.poses.push_back(s->pose);
        found.parents.push_back(alive(s->parent, state) ? name_of(s->parent) : "");
    }
    return found;
}

inline FrameInfo Model::info(std::size_t state, const std::string& name) const {
    const tfdb::Samples all = samples(state, name);
    FrameInfo info;
    info.name = name;
    info.samples = all.stamps.size();
    info.is_static = !all.stamps.empty() && all.stamps.back() < 0;
    if (!all.parents.empty() && !all.parents.back().empty())
        info.parent = all.parents.back();
    const auto frame = static_cast<std::size_t>(find(name, state));
    info.cleared = all.stamps.empty() && frame < samples_.size() && !samples_[frame].empty() &&
                   samples_[frame].front().commit <= state;
    if (all.stamps.empty() || info.is_static)
        return info;
    info.oldest = all.stamps.front();
    info.newest = all.stamps.back();
    for (std::size_t i = 1; i < all.stamps.size(); ++i)
        info.longest_gap = std::max(info.longest_gap, all.stamps[i] - all.stamps[i - 1]);
    return info;
}

inline std::vector<std::string> Model::frames(std::size_t state) const {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
        if (alive(static_cast<int>(i), state))
            names.push_back(frames_[i].name);
    }
    std::sort(names.begin(), names.end());
    return names;
}

/// A sample's parent holds until the next sample; a static edge's parent always holds.
inline int Model::held_parent(const Samples& samples, StampNs stamp, std::size_t state) const {
    int parent = kNone;
    for (const Sample* s : samples) {
        if ((s->is_static || s->stamp <= stamp) && alive(s->parent, state))
            parent = s->parent;
        if (!s->is_static && s->stamp <= stamp && !alive(s->parent, state))
            parent = kNone;
    }
    return parent;
}

inline bool Model::has_cycle(std::size_t state) const {
    // Between two visible stamps no frame changes its parent.
    std::set<StampNs> times{-1};
    for (std::size_t f = 0; f < frames_.size(); ++f) {
        if (!alive(static_cast<int>(f), state))
            continue;
        for (const Sample* s : visible(static_cast<int>(f), state)) {
            if (!s->is_static)
                times.insert(s->stamp);
        }
    }
    for (const StampNs t : times) {
        for (std::size_t f = 0; f < frames_.size(); ++f) {
            int at = static_cast<int>(f);
            if (!alive(at, state))
                continue;
            for (std::size_t steps = 0; at != kNone; ++steps) {
                if (steps > frames_.size())
                    return true;
                at = held_parent(visible(at, state), t, state);
            }
        }
    }
    return false;
}

inline void Model::set(const std::vector<Member>& batch, bool is_static) {
    for (const Member& m : batch) {
        const int parent = find_or_make(m.parent);
        const int child = find_or_make(m.child);
        samples_.resize(frames_.size());
        samples_[static_cast<std::size_t>(child)].push_back(
            {parent, m.stamp, m.pose, commit_ + 1, is_static});
    }
    ++commit_;
    seen_.clear();
}

inline std::map<std::size_t, ErrorCode> Model::faults(const std::vector<Member>& batch,
                                                      bool is_static, WriteRules rules,
                                                      const std::set<std::size_t>& left_out) const {
    std::map<std::size_t, ErrorCode> found;
    std::set<std::pair<std::string, StampNs>> taken;  // by earlier members
    for (std::size_t i = 0; i < batch.size(); ++i) {
        const Member& m = batch[i];
        if (m.parent == m.child) {
            found[i] = ErrorCode::kInvalidTransform;
            continue;
        }
        const auto fault = fault_of_edge(m, is_static, rules);
        if (fault) {
            found[i] = *fault;
        } else if (rules.only_new && left_out.count(i) == 0 &&
                   !taken.insert({m.child, m.stamp}).second) {
            found[i] = ErrorCode::kRepeatedStamp;
        }
    }
    return found;
}

inline std::optional<ErrorCode> Model::fault_of_edge(const Member& m, bool is_static,
                                                     WriteRules rules) const {
    const int child = find(m.child, commit_);
    const Samples samples = child == kNone ? Samples() : visible(child, commit_);
    if (samples.empty())
        return std::nullopt;
    if (samples.back()->is_static != is_static)
        return rules.change_kind ? std::nullopt : std::optional(ErrorCode::kStaticConflict);
    if (is_static)
        return std::nullopt;
    if (history_ && m.stamp < samples.back()->stamp - *history_)
        return ErrorCode::kTooOld;
    const bool known = std::any_of(samples.begin(), samples.end(),
                                   [&](const Sample* s) { return s->stamp == m.stamp; });
    return rules.only_new && known ? std::optional(ErrorCode::kRepeatedStamp) : std::nullopt;
}

inline bool Model::closes_cycle(const std::vector<Member>& batch, bool is_static) const {
    Model trial = *this;
    trial.set(batch, is_static);
    return trial.has_cycle(trial.commit_);
}

inline std::optional<ErrorCode> Model::remove(const std::string& name, bool recursive) {
    const int root = find(name, commit_);
    if (root == kNone)
        return ErrorCode::kUnknownFrame;
    const Policy newest{PolicyKind::kLatest, 0};
    std::vector<int> gone{root};
    for (std::size_t i = 0; i < gone.size(); ++i) {
        for (std::size_t f = 0; f < frames_.size(); ++f) {
            const int id = static_cast<int>(f);
            if (!alive(id, commit_) || parent_at(id, 0, newest, commit_) != gone[i])
                continue;
            if (!recursive)
                return ErrorCode::kFrameInUse;
            gone.push_back(id);
        }
    }
    ++commit_;
    for (const int id : gone)
        frames_[static_cast<std::size_t>(id)].died = commit_;
    return std::nullopt;
}

inline void Model::clear() {
    clears_.push_back(++commit_);
}

}  // namespace tfdb::naive
