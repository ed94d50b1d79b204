// Converts Python objects to transforms, and commits transforms.
#pragma once

#include <nanobind/nanobind.h>

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "arguments.hpp"
#include "arrays.hpp"
#include "pose.hpp"
#include "reads.hpp"
#include "tfdb/store/buffer.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// Commits small requests with the GIL held unless another writer is active, all others without the
/// GIL; returns the commit's number.
CommitNumber commit_write(BufferObject& buffer, WriteRequest request);

/// The frame names passed by a caller: one str, or several.
class FrameNames {
public:
    /// Throws TypeError, InvalidName; with `index` if several were given.
    explicit FrameNames(nb::handle names);

    [[nodiscard]] std::span<const std::string_view> views() const { return views_; }

private:
    nb::object kept_;
    std::vector<std::string_view> views_;
};

/// The frames requested by a caller: one str, or several; None: all.
class ChosenFrames {
public:
    /// Throws as FrameNames.
    explicit ChosenFrames(nb::handle frames) {
        if (!frames.is_none())
            names_.emplace(frames);
    }

    [[nodiscard]] std::optional<std::span<const std::string_view>> only() const {
        return names_ ? std::optional(names_->views()) : std::nullopt;
    }

private:
    std::optional<FrameNames> names_;
};

/// A tfdb.Columns of one edge whose arrays are read in place.
class OneEdge {
public:
    /// Empty: another type, or arrays that need conversion.
    static std::optional<OneEdge> of(nb::handle batch);

    /// Valid during its lifetime; other threads may write into the arrays.
    [[nodiscard]] EdgeColumns columns() const;

private:
    nb::object parent_;
    nb::object child_;
    ArrayView stamps_;
    ArrayView poses_;
};

/// Transforms read from Python objects; the views in `views` are valid during its lifetime.
class Transforms {
public:
    /// A sequence of TransformStamped or similar messages, or a tfdb.Columns, whose missing stamps
    /// become 0. Throws with `index`.
    static Transforms for_message(nb::handle batch);
    /// The same for `set_transforms`. An unreadable member (no stamp, no text, not three numbers)
    /// is recorded, and `views` gets a placeholder that the core refuses.
    static Transforms from_batch(nb::handle batch, bool is_static);
    /// A single moving transform for which `names_its_frames` is true.
    static Transforms from_one(PyObject* transform);

    /// Returns the result of `store(views)`. If the batch is refused, the error lists the
    /// unreadable members as well.
    template <class Store>
    auto give_to(Store&& store) const {
        try {
            return store(std::span<const TransformView>(views));
        } catch (const Error& error) {
            if (unreadable_.empty() || !error.detail().index) {
                throw;
            }
            throw_refused(error);
        }
    }
    /// Records of all refused members, in order, as a list of tfdb.types.Refused.
    [[nodiscard]] nb::list refused(const std::vector<RefusedMember>& by_core) const;

    std::vector<TransformView> views;

private:
    struct Unreadable {
        std::size_t index;
        nb::object error;
    };

    void read_objects(nb::handle batch, bool is_static, bool collect);
    void read_columns(nb::handle columns, bool is_static);
    void read_stamps(const nb::object& stamps);
    void read_names(const nb::object& names, std::string_view TransformView::*field,
                    const char* role);
    std::string_view keep_name(nb::object name, const char* role);
    void read_object(PyObject* item, bool is_static);
    void read_transform(PyObject* item, bool is_static);
    void read_message(PyObject* item, nb::object child);
    template <class Function>
    void collecting(std::size_t index, Function&& function);
    void put_placeholders();
    [[noreturn]] void throw_refused(const Error& error) const;

    std::vector<nb::object> kept_;
    std::vector<Unreadable> unreadable_;
};

/// T[parent<-child] from the arguments of `set_transform`; null for `stamp`: static.
TransformView view_of(PyObject* parent, PyObject* child, PyObject* stamp,
                      const PoseArguments& pose);

/// Whether it is a Transform, a TransformStamped or a similar message.
bool names_its_frames(PyObject* object);

/// Returns the result of `store(view, authority, rules)` for the arguments of a `set_transform`,
/// with or without write rules.
template <bool kRules, class Store>
auto read_set_transform(PyObject* const* args, Py_ssize_t count, PyObject* keywords,
                        Store&& store) {
    constexpr std::size_t kRuleCount = kRules ? 2 : 0;
    static constexpr std::array<std::string_view, 10> kNames = {
        "parent", "child", "stamp",     "translation", "rotation",
        "rpy",    "wxyz",  "authority", "change_kind", "only_new"};
    static constexpr std::array<std::string_view, 4> kWholeNames = {"transform", "authority",
                                                                    "change_kind", "only_new"};
    const auto authority_of = [](PyObject* authority) {
        return authority == nullptr ? std::string_view() : name_of(authority, "authority");
    };
    const auto rules_of = [](const auto& given) {
        if constexpr (kRules) {
            const std::size_t first = given.size() - kRuleCount;
            return WriteRules{flag_of(given[first], "change_kind"),
                              flag_of(given[first + 1], "only_new")};
        }
        return WriteRules{};
    };
    if (count == 1 && names_its_frames(args[0])) [[unlikely]] {
        constexpr std::size_t kCount = 2 + kRuleCount;
        constexpr ParameterList kList{"set_transform", std::span(kWholeNames).first(kCount), 1, 1};
        const auto given = bind<kCount>(kList, args, count, keywords);
        const WriteRules rules = rules_of(given);
        const Transforms one = Transforms::from_one(given[0]);
        return store(one.views.front(), authority_of(given[1]), rules);
    }
    constexpr std::size_t kCount = 8 + kRuleCount;
    constexpr ParameterList kList{"set_transform", std::span(kNames).first(kCount), 4, 5};
    const auto given = bind<kCount>(kList, args, count, keywords);
    const auto [parent, child, stamp] = std::array{given[0], given[1], given[2]};
    const WriteRules rules = rules_of(given);
    const TransformView view =
        view_of(parent, child, stamp, {given[3], given[4], given[5], given[6], parent, child});
    return store(view, authority_of(given[7]), rules);
}

}  // namespace tfdb::python
