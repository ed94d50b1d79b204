// Frames, samples and statistics of the store as Python dataclasses.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <string_view>
#include <utility>

#include "arrays.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "records.hpp"
#include "stamp.hpp"

namespace tfdb::python {
namespace {

nb::object stamp_or_none(StampNs stamp) {
    return stamp < 0 ? nb::object(nb::none()) : nb::object(nb::int_(stamp));
}

/// `Info`: FrameInfo or a row of TreeColumns.
template <class Info>
std::optional<double> rate_of(const Info& info) {
    if (info.is_static || info.samples < 2 || info.newest <= info.oldest) {
        return std::nullopt;
    }
    return static_cast<double>(info.samples - 1) / clock::to_seconds(info.newest - info.oldest);
}

template <class T, class Value>
nb::object column_of(const std::vector<TreeColumns::Row>& rows, NewArray<T> made, Value value) {
    std::transform(rows.begin(), rows.end(), made.data, value);
    return std::move(made.array);
}

/// For each row, a new reference to one of the names, or to None.
nb::object name_column(const std::vector<TreeColumns::Row>& rows, const nb::tuple& names,
                       std::uint32_t TreeColumns::Row::*place) {
    nb::object made = nb::steal(PyTuple_New(static_cast<Py_ssize_t>(rows.size())));
    if (!made.is_valid()) {
        throw nb::python_error();
    }
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const std::uint32_t at = rows[i].*place;
        PyObject* const name =
            at == TreeColumns::kNone ? Py_None : NB_TUPLE_GET_ITEM(names.ptr(), at);
        NB_TUPLE_SET_ITEM(made.ptr(), static_cast<Py_ssize_t>(i), Py_NewRef(name));
    }
    return made;
}

nb::tuple name_tuple(const std::vector<std::string>& names, nb::str (*make)(std::string_view)) {
    nb::object made = nb::steal(PyTuple_New(static_cast<Py_ssize_t>(names.size())));
    if (!made.is_valid()) {
        throw nb::python_error();
    }
    for (std::size_t i = 0; i < names.size(); ++i) {
        NB_TUPLE_SET_ITEM(made.ptr(), static_cast<Py_ssize_t>(i), make(names[i]).release().ptr());
    }
    return nb::borrow<nb::tuple>(made);
}

nb::object frame_info_of(const nb::object& type, const FrameInfo& info) {
    return type(str_of_name(info.name), name_or_none(info.parent), info.is_static, info.samples,
                stamp_or_none(info.oldest), stamp_or_none(info.newest), nb::cast(rate_of(info)),
                escaped(info.authority), info.late, info.longest_gap, info.cleared);
}

nb::object frame_info(nb::handle self, nb::handle name) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const std::string_view bytes = name_of(name, "name");
    const FrameInfo info =
        pinned.ask_long([&](const StoreReader& reads) { return reads.frame_info(bytes); });
    return frame_info_record(info);
}

nb::object parent_of(nb::handle self, nb::handle name, nb::handle when) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const std::string_view bytes = name_of(name, "name");
    const std::optional<StampNs> stamp = optional_stamp_of(when.ptr());
    return name_or_none(
        pinned.ask([&](const StoreReader& reads) { return reads.parent_of(bytes, stamp); }));
}

/// None: the walks meet, or a frame is missing. Otherwise the edge (None: both end at roots), the
/// stamp, the edge's data.
nb::object reach(nb::handle self, nb::handle target, nb::handle source, nb::handle when) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const std::string_view to = name_of(target, "target");
    const std::string_view from = name_of(source, "source");
    std::optional<StampNs> stamp;
    if (!when.is_none()) {
        int overflow = 0;
        stamp = PyLong_AsLongLongAndOverflow(when.ptr(), &overflow);
        if (overflow != 0) {
            stamp = overflow < 0 ? StampNs{-1} : clock::kMaxStamp + 1;
        } else if (*stamp == -1 && PyErr_Occurred() != nullptr) {
            throw nb::python_error();
        }
    }
    const Reach found =
        pinned.ask([&](const StoreReader& reads) { return reads.reach(to, from, stamp); });
    switch (found.end) {
        case Reach::kMet:
        case Reach::kNowhere:
            return nb::none();
        case Reach::kApart:
            return nb::make_tuple(nb::none(), found.stamp, nb::none(), nb::none());
        case Reach::kGap:
            break;
    }
    return nb::make_tuple(str_of_name(found.edge), found.stamp, stamp_or_none(found.oldest),
                          stamp_or_none(found.newest));
}

nb::list tree(nb::handle self, nb::handle when) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const std::optional<StampNs> stamp = optional_stamp_of(when.ptr());
    return frame_info_records(
        pinned.ask_long([&](const StoreReader& reads) { return reads.tree(stamp); }));
}

nb::object tree_columns(nb::handle self, nb::handle when) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const std::optional<StampNs> stamp = optional_stamp_of(when.ptr());
    return tree_columns_record(
        pinned.ask_long([&](const StoreReader& reads) { return reads.tree_columns(stamp); }));
}

/// Without records: importing their types takes longer than answering a command.
nb::object span(nb::handle self) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const TreeColumns all =
        pinned.ask_long([](const StoreReader& reads) { return reads.tree_columns(std::nullopt); });
    StampNs first = clock::kMaxStamp;
    StampNs last = -1;
    for (const TreeColumns::Row& row : all.rows) {
        if (row.oldest >= 0)
            first = std::min(first, row.oldest);
        last = std::max(last, row.newest);
    }
    return last < 0 ? nb::object(nb::none()) : nb::object(nb::make_tuple(first, last));
}

nb::tuple samples(nb::handle self, nb::handle name) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const std::string_view bytes = name_of(name, "name");
    return samples_record(
        pinned.ask_long([&](const StoreReader& reads) { return reads.samples(bytes); }));
}

nb::list frames(nb::handle self) {
    return name_list(
        pin(self, object_of<StoreReaderObject>(self)).ask([](const StoreReader& reads) {
            return reads.frames();
        }));
}

bool frame_exists(nb::handle self, nb::handle name) {
    const Pinned pinned = pin(self, object_of<StoreReaderObject>(self));
    const std::string_view bytes = name_of(name, "name");
    return pinned.ask([&](const StoreReader& reads) {
        FrameHandle handle;
        return reads.find_frame(bytes, handle);
    });
}

}  // namespace

nb::object record_type(const char* name) {
    return nb::module_::import_("tfdb.data.types").attr(name);
}

nb::object frame_info_record(const FrameInfo& info) {
    return frame_info_of(record_type("FrameInfo"), info);
}

nb::list frame_info_records(const std::vector<FrameInfo>& infos) {
    const nb::object type = record_type("FrameInfo");
    nb::list made;
    for (const FrameInfo& info : infos) {
        made.append(frame_info_of(type, info));
    }
    return made;
}

nb::object tree_columns_record(const TreeColumns& columns) {
    using Row = TreeColumns::Row;
    const std::vector<Row>& rows = columns.rows;
    const auto numbers = [&](auto Row::*field) {
        return column_of(rows, new_stamps(rows.size()),
                         [field](const Row& row) { return static_cast<StampNs>(row.*field); });
    };
    const auto flags = [&](bool Row::*field) {
        return column_of(rows, new_flags(rows.size()),
                         [field](const Row& row) { return row.*field; });
    };
    const auto rate = [](const Row& row) {
        return rate_of(row).value_or(std::numeric_limits<double>::quiet_NaN());
    };
    const nb::tuple names = name_tuple(columns.names, str_of_name);
    return record_type("TreeColumns")(
        names, name_column(rows, names, &Row::parent), flags(&Row::is_static),
        numbers(&Row::samples), numbers(&Row::oldest), numbers(&Row::newest),
        column_of(rows, new_doubles({rows.size()}), rate),
        name_column(rows, name_tuple(columns.authorities, escaped), &Row::authority),
        numbers(&Row::late), numbers(&Row::longest_gap), flags(&Row::cleared));
}

nb::list name_list(const std::vector<std::string>& names) {
    nb::list list;
    nb::object last;
    for (std::size_t i = 0; i < names.size(); ++i) {
        if (i == 0 || names[i] != names[i - 1])
            last = str_of_name(names[i]);
        list.append(last);
    }
    return list;
}

nb::tuple samples_record(const Samples& found) {
    nb::object stamps = stamp_array(found.stamps);
    auto* const data = ArrayView::of(stamps, true)->data<StampNs>();
    std::transform(data, data + found.stamps.size(), data,
                   [](StampNs stamp) { return std::max<StampNs>(stamp, 0); });
    const NewArray<double> poses = new_doubles({found.poses.size(), 7});
    if (!found.poses.empty()) {
        std::memcpy(poses.data, found.poses.data(), found.poses.size() * sizeof(geometry::Pose));
    }
    return nb::make_tuple(stamps, poses.array, name_list(found.parents));
}

nb::object twist_record(const Twist& twist) {
    const auto array_of = [](const geometry::Vec3& vector) {
        const NewArray<double> made = new_doubles({3});
        std::memcpy(made.data, &vector, sizeof vector);
        return made.array;
    };
    return record_type("Twist")(array_of(twist.linear), array_of(twist.angular));
}

nb::object stamp_array(const std::vector<StampNs>& stamps) {
    const NewArray<StampNs> made = new_stamps(stamps.size());
    std::copy(stamps.begin(), stamps.end(), made.data);
    return made.array;
}

nb::object memory_record(const MemoryUse& use) {
    return record_type("MemoryUse")(use.used_bytes, use.free_bytes, use.frames, use.samples,
                                    use.frame_bytes, use.authority_bytes);
}

nb::object counters_record(const Counters& counters) {
    return record_type("Counters")(counters.commits, counters.normalised, counters.lapped_reads,
                                   counters.pinned_reads, counters.aborts, counters.conflicts,
                                   counters.retries, counters.lock_waits);
}

void bind_records(nb::class_<StoreReaderObject>& type) {
    type.def("frames", &frames, nb::sig("def frames(self) -> list[str]"),
             "Names of all frames, sorted.");
    type.def("frame_exists", &frame_exists, nb::arg("name").none(),
             nb::sig("def frame_exists(self, name: str) -> bool"),
             "Return whether a frame has that name. Raises SnapshotTooOld.");
    type.def("frame_info", &frame_info, nb::arg("name").none(),
             nb::sig("def frame_info(self, name: str) -> tfdb.types.FrameInfo"),
             "Return facts about one frame and the edge to its parent. Raises UnknownFrame.");
    type.def(
        "parent_of", &parent_of, nb::arg("name").none(), nb::arg("stamp") = nb::none(),
        nb::sig("def parent_of(self, name: str, stamp: tfdb.types.StampLike | None = None) -> "
                "str | None"),
        R"(The parent that a frame has at a stamp (None: in its newest sample); None for a root.

A sample's parent holds from its stamp to that of the next sample. Before the first and after the
last sample, the parent of the nearest one holds. If first parents would form a cycle, their frames
are roots before their first samples. A static edge has its parent at every stamp. Raises
UnknownFrame.)");
    type.def(
        "_reach", &reach, nb::arg("target").none(), nb::arg("source").none(),
        nb::arg("stamp").none(),
        nb::sig("def _reach(self, target: str, source: str, stamp: int | None) -> tuple[str | "
                "None, int, int | None, int | None] | None"),
        R"(Where walks up from two frames stop for want of data; None: they meet, or one does not exist.

Walks up from the source to its root, then from the target to where that ended, as far as each edge
has data. Returns the edge that the second walk stopped at, else that of the first (None: both
ended at roots), the stamp, and the edge's oldest and newest stamp (None: it was cleared).)");
    type.def("tree", &tree, nb::arg("stamp") = nb::none(),
             nb::sig("def tree(self, stamp: tfdb.types.StampLike | None = None) -> "
                     "list[tfdb.types.FrameInfo]"),
             "All frames, sorted by name, with the parents they have at a stamp (None: newest).");
    type.def("tree_columns", &tree_columns, nb::arg("stamp") = nb::none(),
             nb::sig("def tree_columns(self, stamp: tfdb.types.StampLike | None = None) -> "
                     "tfdb.types.TreeColumns"),
             R"(The frames and facts of `tree(stamp)` as columns, for stores of many frames.

Row i is the i-th frame by name; the values are those of its FrameInfo. Arrays have -1 or NaN in
place of None.)");
    type.def("_span", &span, nb::sig("def _span(self) -> tuple[int, int] | None"),
             "The first and the last stamp of all moving edges; None where nothing moves.");
    type.def("samples", &samples, nb::arg("name").none(),
             nb::sig("def samples(self, name: str) -> tuple[numpy.typing.NDArray[numpy.int64], "
                     "numpy.typing.NDArray[numpy.float64], list[str]]"),
             R"(All retained samples T[parent<-name] of the edge from `name` to its parents.

Returns (stamps (N,) int64, poses (N, 7) float64, N names of parents), sorted by stamp. A static
edge has one, with stamp 0; a root none. Raises UnknownFrame.)");
}

}  // namespace tfdb::python
