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

/// The transforms that a store with unlimited history keeps of messages, with their arrival.
/// Threads: one. Guarantee: of a message that `add` throws for, a part may be there.
class Arrivals {
public:
    /// Of one child frame. Parents and publishers are indices of `names`.
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

    /// `with_store`: a store judges. Otherwise a survey does, which is right while it is a tree.
    explicit Arrivals(bool with_store);

    /// Adds what a store keeps of a message; `keep(i)` is called for each member that it keeps.
    template <class Keep>
    void add(std::span<const wire::TransformView> members, const Message& message, Keep keep) {
        judge(members, message.is_static);
        const std::int64_t publisher = id(message.publisher);
        for (std::size_t i = 0; i < members.size(); ++i) {
            if (!is_kept_[i])
                continue;
            append(members[i], message, publisher);
            keep(i);
        }
    }
    /// Stores static transforms that did not arrive.
    void hold(std::span<const wire::TransformView> members) { judge(members, true); }

    /// False: what was added may not be what a store keeps; a store must judge.
    [[nodiscard]] bool is_right() const { return store_ || survey_.is_tree(); }
    [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
    /// By child, and by whether they are static: transforms refused with StaticConflict.
    [[nodiscard]] const std::map<std::pair<std::string, bool>, std::uint64_t>& conflicts() const {
        return conflicts_;
    }
    /// By child, in the order of the names. What is taken out of it is gone.
    [[nodiscard]] std::map<std::string, Columns, std::less<>>& columns() { return columns_; }

private:
    void judge(std::span<const wire::TransformView> members, bool is_static);
    void judge_by_store(std::span<const wire::TransformView> members, bool is_static);
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
