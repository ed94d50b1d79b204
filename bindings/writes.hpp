// From Python objects to transforms, and from transforms to a commit.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "arrays.hpp"
#include "pose.hpp"
#include "reads.hpp"
#include "tfdb/store/buffer.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// Commits with the GIL held if no other writer is at it, else waits without the GIL.
CommitNumber commit_transforms(BufferObject& buffer, std::span<const TransformView> batch,
                               bool is_static, std::string_view authority, WriteRules rules = {});

CommitNumber commit_transforms(BufferObject& buffer, const EdgeColumns& columns,
                               std::string_view authority, WriteRules rules);

/// A tfdb.Columns of one edge whose arrays are read where they lie.
class OneEdge {
public:
    /// None: it is something else, or its arrays are to be converted first.
    static std::optional<OneEdge> of(nb::handle batch);

    /// Valid while this lives; others may write into the arrays.
    [[nodiscard]] EdgeColumns columns() const;

private:
    nb::object parent_;
    nb::object child_;
    ArrayView stamps_;
    ArrayView poses_;
};

/// Transforms read from Python objects; the views in `views` stay valid while it lives.
class Transforms {
public:
    /// A sequence of TransformStamped and of messages like it, or a tfdb.Columns, whose stamps are
    /// 0 where it has none. Throws with `index`.
    static Transforms for_message(nb::handle batch);
    /// The same: what `set_transforms` takes. A member that cannot be read (no
    /// stamp, no text, not three numbers) is remembered, and a stand-in into `views`
    /// that the core refuses.
    static Transforms from_batch(nb::handle batch, bool is_static);

    /// What `store(views)` returns. If it refuses the batch, the error knows the unreadable members
    /// too.
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
    /// Records of all refused members, in their order, as a list of tfdb.types.Refused.
    [[nodiscard]] nb::list refused(const std::vector<RefusedMember>& by_core) const;

    std::vector<TransformView> views;

private:
    struct Unreadable {
        std::size_t index;
        nb::object error;
    };

    void read_objects(nb::handle batch, bool collect);
    void read_columns(nb::handle columns, bool is_static);
    void read_stamps(const nb::object& stamps);
    void read_names(const nb::object& names, std::string_view TransformView::*field,
                    const char* role);
    std::string_view keep_name(nb::object name, const char* role);
    void read_object(PyObject* item);
    void read_message(PyObject* item, nb::object child);
    template <class Function>
    void collecting(std::size_t index, Function&& function);
    void put_stand_ins();
    [[noreturn]] void throw_refused(const Error& error) const;

    std::vector<nb::object> kept_;
    std::vector<Unreadable> unreadable_;
};

/// T[parent<-child] from the arguments of `set_transform`; null for `stamp`: a static one.
TransformView view_of(PyObject* parent, PyObject* child, PyObject* stamp,
                      const PoseArguments& pose);

}  // namespace tfdb::python
