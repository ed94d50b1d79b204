// Recorded transforms in the order of their arrival, by child frame.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tfdb/clock/stamp.hpp"
#include "tfdb/geometry/pose.hpp"
#include "tfdb/store/buffer.hpp"
#include "tfdb/store/edge_survey.hpp"
#include "tfdb/wire/tf_message.hpp"

namespace tfdb {

/// The transforms that a store with unlimited history keeps of the messages, with their arrival
/// times.
/// Threads: one. Guarantee: if `add` throws, a part of the message may have been added.
class Arrivals {
public:
    /// Columns of one child frame. Parents and publishers are indices of `names`.
    struct Columns {
        std::vector<clock::StampNs> stamps;
        std::vector<std::int64_t> received;
        std::vector<geometry::Pose> poses;
        std::vector<std::int64_t> parents;
        std::vector<std::int64_t> publishers;
        std::vector<char> is_static;
    };
    struct Message {
        std::int64_t received;
        std::string_view publisher;
        bool is_static;
    };

    /// `with_store`: a store validates the transforms. Otherwise an EdgeSurvey does, which is exact
    /// for trees.
    explicit Arrivals(bool with_store);

    /// Adds the transforms that a store keeps of a message; calls `keep(i)` for each of these
    /// members.
    template <class Keep>
    void add(std::span<const wire::TransformView> members, const Message& message, Keep keep) {
        validate(members, message.is_static);
        const std::int64_t publisher = id(message.publisher);
        for (std::size_t i = 0; i < members.size(); ++i) {
            if (!is_kept_[i])
                continue;
            append(members[i], message, publisher);
            keep(i);
        }
    }
    /// Stores static transforms that have no arrival.
    void hold(std::span<const wire::TransformView> members) { validate(members, true); }

    /// False: the result may differ from a store's; a store is needed.
    [[nodiscard]] bool is_right() const { return store_ || survey_.is_tree(); }
    [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
    /// Numbers of transforms refused with StaticConflict, by child and by whether they are static.
    [[nodiscard]] const std::map<std::pair<std::string, bool>, std::uint64_t>& conflicts() const {
        return conflicts_;
    }
    /// By child, ordered by name. The caller may move columns out.
    [[nodiscard]] std::map<std::string, Columns, std::less<>>& columns() { return columns_; }

private:
    void validate(std::span<const wire::TransformView> members, bool is_static);
    void validate_by_store(std::span<const wire::TransformView> members, bool is_static);
    void append(const wire::TransformView& member, const Message& message, std::int64_t publisher);
    std::int64_t id(std::string_view name);

    EdgeSurvey survey_;
    std::optional<Buffer> store_;
    std::vector<bool> is_kept_;
    std::map<std::string, Columns, std::less<>> columns_;
    std::map<std::pair<std::string, bool>, std::uint64_t> conflicts_;
    std::vector<std::string> names_;
    std::map<std::string, std::int64_t, std::less<>> ids_;
};

}  // namespace tfdb
