// Common parts of all ways to store samples: validated batches, filled samples, and the commit that
// stores a batch.
#pragma once

#include <bit>
#include <cmath>
#include <span>
#include <string_view>
#include <vector>

#include "tfdb/store/store.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb::store {

/// A batch as passed by the caller, and whether its numbers, stamps and parents are valid: all
/// checks that need no lock.
/// Threads: a value. Guarantee: wait-free; the members are the caller's and must outlive it.
class Batch {
public:
    Batch(std::span<const TransformView> members, bool is_static, std::string_view authority,
          WriteRules rules)
        : members_(members),
          authority_(authority),
          rules_(rules),
          is_static_(is_static),
          sound_(is_sound(members, is_static)) {}
    /// The same options with other members.
    [[nodiscard]] Batch with(std::span<const TransformView> members) const {
        return {members, is_static_, authority_, rules_};
    }

    [[nodiscard]] std::span<const TransformView> members() const { return members_; }
    [[nodiscard]] std::size_t size() const { return members_.size(); }
    [[nodiscard]] const TransformView& operator[](std::size_t i) const { return members_[i]; }
    [[nodiscard]] bool is_static() const { return is_static_; }
    [[nodiscard]] std::string_view authority() const { return authority_; }
    [[nodiscard]] WriteRules rules() const { return rules_; }
    /// If false, `commit_batch` throws; other ways to store leave such a batch to it.
    [[nodiscard]] bool sound() const { return sound_; }

private:
    std::span<const TransformView> members_;
    std::string_view authority_;
    WriteRules rules_;
    bool is_static_;
    bool sound_;
};

/// Whether a quaternion's norm is so far from one that its normalisation counts.
[[nodiscard]] inline bool counts_as_normalised(const geometry::Quat& q) {
    return std::abs(geometry::norm_squared(q) - 1.0) > 2e-9;
}

/// Fills the sample word by word: a block copy of the pose would go through memory and stall.
inline void fill_payload(const Pose& pose, history::NewSample<StoreMemory>& sample) {
    const geometry::Vec3& t = pose.translation;
    geometry::Quat q = pose.rotation;
    // A normalised quaternion is stored unchanged, so that copies are equal bit for bit. Its
    // computed squared norm is off by at most 14 roundings of 1.1e-16.
    constexpr double kRoundings = 1.6e-15;
    if (std::abs(geometry::norm_squared(q) - 1.0) > kRoundings)
        q = geometry::normalized(q);
    const double numbers[7] = {t.x, t.y, t.z, q.x, q.y, q.z, q.w};
    for (std::size_t i = 0; i < 7; ++i) {
        sample.payload[i] = std::bit_cast<std::uint64_t>(numbers[i]);
    }
}
/// Fills the whole sample; returns whether its normalisation counts.
inline bool fill_from(const TransformView& transform, FrameId parent, bool is_static,
                      history::NewSample<StoreMemory>& sample) {
    sample.stamp = is_static ? history::kStaticStamp : transform.stamp;
    sample.parent = parent;
    fill_payload(transform.pose, sample);
    return counts_as_normalised(transform.pose.rotation);
}

/// The same, counted at once: for a sample that can no longer be refused.
inline void fill_sample(Store& store, const TransformView& transform, FrameId parent,
                        bool is_static, history::NewSample<StoreMemory>& sample) {
    if (fill_from(transform, parent, is_static, sample))
        store.word(graph::kNormalised).fetch_add(1);
}

/// Throws InvalidArgument.
void check_rules(WriteRules rules, bool is_static);

// The caller of these holds the commit lock, and no other write is in progress. If they throw, the
// store is unchanged.

/// Stores all of a batch in one commit; returns its number. Throws as Buffer::write.
CommitNumber commit_batch(Store& store, const Batch& batch);
/// Stores the valid members of a batch in one commit, and returns the others.
WriteResult commit_partial(Store& store, const Batch& batch);
/// Removes frames in one commit; returns its number. Throws as Buffer::remove_frames.
CommitNumber commit_removal(Store& store, std::span<const std::string_view> names, bool recursive);

}  // namespace tfdb::store
