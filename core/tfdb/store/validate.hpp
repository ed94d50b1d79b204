// The conditions of a write, and the errors of their violations.
#pragma once

#include <cmath>
#include <cstdint>
#include <exception>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "tfdb/store/store.hpp"

namespace tfdb::store {

/// Why a member of a batch is invalid; none if it can be stored.
using Fault = std::optional<Error>;

[[nodiscard]] inline bool is_finite(const geometry::Vec3& t) noexcept {
    // Zero times a finite number is zero; times infinity or NaN it is NaN.
    const double probe = 0.0 * (t.x + t.y + t.z);
    return probe == 0.0 || (std::isfinite(t.x) && std::isfinite(t.y) && std::isfinite(t.z));
}
[[nodiscard]] inline bool is_rotation(const geometry::Quat& q) noexcept {
    return std::abs(geometry::norm_squared(q) - 1.0) <= 0.01;
}
/// Whether `fault_alone` accepts every member.
[[nodiscard]] bool is_sound(std::span<const TransformView> batch, bool is_static) noexcept;
/// Whether `fault_of_names` accepts the names.
[[nodiscard]] bool has_sound_names(const TransformView& transform) noexcept;
/// Whether the edge has samples of the other kind, moving or static.
[[nodiscard]] inline bool changes_kind(const history::EdgeWriter<StoreMemory>& edge,
                                       bool is_static) {
    return edge.has_samples() && edge.is_static() != is_static;
}
/// Whether a moving edge has a sample at that stamp. The caller holds the commit lock, and has not
/// written to the edge.
[[nodiscard]] bool has_stamp(const Store& store, FrameId child, StampNs stamp);
/// Whether `fault_of_edge` accepts the sample. Only committed samples count.
[[nodiscard]] inline bool is_storable(const Store& store, FrameId child,
                                      const TransformView& transform, bool is_static,
                                      WriteRules rules) {
    if (store.writer_of(child)) [[unlikely]]
        return false;
    const history::EdgeWriter<StoreMemory> edge(store.frames.memory(), store.frames.header(child));
    if (changes_kind(edge, is_static))
        return rules.change_kind;
    if (is_static || !edge.has_samples() || transform.stamp > edge.newest())
        return true;
    return transform.stamp >= edge.newest() - store.history &&
           !(rules.only_new && has_stamp(store, child, transform.stamp));
}

/// Checks a member without the store: InvalidTransform, InvalidStamp.
[[nodiscard]] Fault fault_alone(const TransformView& transform, std::size_t index, bool is_static,
                                std::string_view authority);
/// Checks the names of a member with a new frame: InvalidName.
[[nodiscard]] Fault fault_of_names(const TransformView& transform, std::size_t index,
                                   std::string_view authority);
/// Throws InvalidName if no frame can have the name; `what` begins the message.
void check_may_exist(std::string_view name, const char* what);
/// Throws InvalidName if the question has a name that no frame can have.
void check_may_exist(const Question& question);
/// Checks a sample against its edge: ReadOnly, StaticConflict, TooOld, RepeatedStamp.
[[nodiscard]] Fault fault_of_edge(const Store& store, FrameId child, const TransformView& transform,
                                  std::size_t index, bool is_static, std::string_view authority,
                                  WriteRules rules);
/// `source`: the source of the edge's samples.
[[nodiscard]] Error read_only(const TransformView& transform, std::size_t index,
                              std::string_view source, std::string_view authority);
[[nodiscard]] Error repeated_stamp(const TransformView& transform, std::size_t index,
                                   std::string_view authority);
/// `other_way`: the alternative that the message names after the one that always works.
[[nodiscard]] Error static_conflict(const TransformView& transform, std::size_t index,
                                    bool is_static, std::string_view authority,
                                    const char* other_way = "");
/// `newest`: the greatest stamp of the edge, before which `history` is retained.
[[nodiscard]] Error too_old(const TransformView& transform, std::size_t index, StampNs newest,
                            StampNs history, std::string_view authority);
/// For a frame that was to be removed, at `index` of the call's names. `hint` ends the message.
[[nodiscard]] Error unknown_frame(std::string_view name, std::size_t index,
                                  const std::string& hint);
/// For a frame of `source`, at `index` of the call's names.
[[nodiscard]] ReadOnly read_only_frame(std::string_view name, std::optional<std::size_t> index,
                                       std::string_view source);
/// `advice` ends the message.
[[nodiscard]] Error frame_in_use(std::string_view name, std::size_t index,
                                 std::vector<std::string> children, const std::string& advice);
/// For a removal that leaves children: FrameInUse, or ReadOnly for a frame of `source`.
[[nodiscard]] Error used_frame(std::string_view name, std::size_t index,
                               const std::optional<std::string>& source,
                               std::vector<std::string> children);
[[nodiscard]] Error cycle_fault(const TransformView& transform, std::size_t index, bool is_static,
                                std::string_view authority);

/// The rejected members of a batch.
/// Threads: one. Guarantee: plain code that may allocate.
class Refusals {
public:
    /// `error` has the member's index.
    void add(Error error) { errors_.push_back(std::move(error)); }
    void add(Fault fault) {
        if (fault)
            add(std::move(*fault));
    }
    [[nodiscard]] bool empty() const { return errors_.empty(); }
    [[nodiscard]] std::size_t size() const { return errors_.size(); }

    /// In the order of the batch.
    [[nodiscard]] std::vector<RefusedMember> members();
    /// Throws the first one's error. `of`: the total number and the kind of the members.
    [[noreturn]] void raise(const std::string& of);

private:
    void sort();

    std::vector<Error> errors_;
};

/// Whether the bytes are UTF-8 without NUL, as names in messages and Python.
[[nodiscard]] bool is_text(std::string_view name) noexcept;

/// A hint for a stamp outside an edge's data that is probably a mistake. It covers stamps that
/// would lie inside if they were seconds or counted from the first sample; near the newest sample
/// if that were seconds; and, in a lookup, 0. Otherwise empty.
std::string likely_meant(StampNs stamp, StampNs oldest, StampNs newest);

/// A frame name for a message: quoted, cut when long, control characters escaped.
std::string quoted(std::string_view name);

/// T[target<-source] for a message.
std::string transform_name(std::string_view target, std::string_view source);

}  // namespace tfdb::store
