// The changes of commits as Python records.
#include <nanobind/stl/string.h>

#include <cstring>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "arrays.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "records.hpp"
#include "writes.hpp"

namespace tfdb::python {
namespace {

nb::tuple tuple_of(const std::vector<std::string>& names) {
    nb::list list;
    for (const std::string& name : names) {
        list.append(str_of_name(name));
    }
    return nb::tuple(list);
}

/// The samples of some edges as one `Columns`.
nb::object columns_of(const nb::object& type, const std::vector<Changes::Edge>& edges,
                      bool is_static) {
    nb::list parents;
    nb::list children;
    std::size_t rows = 0;
    for (const auto& edge : edges) {
        if (edge.is_static != is_static || edge.poses.empty())
            continue;
        const nb::str child = str_of_name(edge.child);
        nb::object parent;
        for (std::size_t i = 0; i < edge.poses.size(); ++i) {
            if (i == 0 || edge.parents[i] != edge.parents[i - 1])
                parent = str_of_name(edge.parents[i]);
            parents.append(parent);
            children.append(child);
        }
        rows += edge.poses.size();
    }
    const NewArray<StampNs> stamps = is_static ? NewArray<StampNs>{} : new_stamps(rows);
    const NewArray<double> poses = new_doubles({rows, 7});
    std::size_t row = 0;
    for (const auto& edge : edges) {
        if (edge.is_static != is_static || edge.poses.empty())
            continue;
        if (!is_static)
            std::copy(edge.stamps.begin(), edge.stamps.end(), stamps.data + row);
        std::memcpy(poses.data + 7 * row, edge.poses.data(),
                    edge.poses.size() * sizeof(geometry::Pose));
        row += edge.poses.size();
    }
    // It skips the checks of the constructor, which these arrays satisfy.
    nb::object made = type.attr("__new__")(type);
    made.attr("parents") = parents;
    made.attr("children") = children;
    made.attr("stamps") = is_static ? nb::object(nb::none()) : stamps.array;
    made.attr("poses") = poses.array;
    return made;
}

/// The writer of each row, in the order of `columns_of`: moving edges first.
nb::tuple authorities_of(const std::vector<Changes::Edge>& edges) {
    nb::list authorities;
    for (const bool is_static : {false, true}) {
        for (const auto& edge : edges) {
            if (edge.is_static != is_static || edge.poses.empty())
                continue;
            const nb::str authority = str_of_name(edge.authority);
            for (std::size_t i = 0; i < edge.poses.size(); ++i)
                authorities.append(authority);
        }
    }
    return nb::tuple(authorities);
}

nb::list changes(nb::handle self, nb::handle since, nb::handle limit, nb::handle frames) {
    BufferObject& buffer = object_of<BufferObject>(self);
    const CommitNumber from = count_of(since, "since", 0, kMaxCommit);
    const std::size_t most =
        limit.is_none() ? Buffer::kNoLimit : count_of(limit, "limit", 1, Buffer::kNoLimit);
    const ChosenFrames chosen(frames);
    std::vector<Changes> all;
    {
        const LongWork work(true);
        all = buffer.open_store().changes(from, most, chosen.only());
    }
    const nb::object record = record_type("Changes");
    const nb::object columns = record_type("Columns");
    nb::list result;
    for (const Changes& one : all) {
        nb::dict gone;
        for (const auto& edge : one.stored) {
            if (edge.gone != 0)
                gone[str_of_name(edge.child)] = edge.gone;
        }
        result.append(record(one.commit, columns_of(columns, one.stored, false),
                             columns_of(columns, one.stored, true), authorities_of(one.stored),
                             tuple_of(one.made), tuple_of(one.moved), tuple_of(one.cleared),
                             tuple_of(one.removed), tuple_of(one.passing), gone));
    }
    return result;
}

constexpr const char* kChangesDoc =
    R"(Return the changes of each commit after `since`, in order.

A record has all data of its commit that the newest state still has. Data that were evicted,
replaced, cleared or removed since then may be missing; `gone` counts them. A held snapshot of
commit `since`, or of an older one, prevents this. A record does not contain the order of a
transaction's operations; the guide "Follow the changes" shows how to keep a copy.

Parameters
----------
since
    Number of a commit: that of a snapshot, or of the last record. 0: from the beginning.
limit
    Largest number of records; None: all.
frames
    A frame, or several: only changes of these frames and their edges, and only commits that have
    some. A frame may be created later. A follower should read the buffer's `commit` before the
    call: if fewer than `limit` records come, that commit is its next `since`. None: all frames.

Returns
-------
list[Changes]
    Empty if nothing was committed since.

Raises
------
FeedLapped
    The feed no longer has the commit after `since`: it keeps the last 16,384 commits, fewer if they
    are large. Take a snapshot and follow from its `commit`, or continue from the error's `commit`
    and miss the commits before. The error's `oldest` is the commit that is overwritten next.
InvalidArgument
    The commit does not exist yet, or `limit` is not positive.
InvalidName
    A name in `frames` is invalid.
NotSupported
    The engine has no feed; only `snapshot` and `giant` have one.
TransactionActive
    This thread has a transaction open in the store.)";

}  // namespace

void bind_changes(nb::class_<BufferObject, StoreReaderObject>& type) {
    type.def("changes", &changes, nb::arg("since").none(), nb::arg("limit").none() = nb::none(),
             nb::kw_only(), nb::arg("frames").none() = nb::none(),
             nb::sig("def changes(self, since: int, limit: int | None = None, *, "
                     "frames: str | collections.abc.Iterable[str] | None = None) -> "
                     "list[tfdb.types.Changes]"),
             kChangesDoc);
}

}  // namespace tfdb::python
