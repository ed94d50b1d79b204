// Samples of commits as the rows of one table, and as records: what streams read.
#include <cstring>
#include <vector>

#include "arguments.hpp"
#include "arrays.hpp"
#include "bytes_like.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "tfdb/wire/commit_sample.hpp"
#include "transform.hpp"

namespace tfdb::python {
namespace {

using wire::CommitSample;

nb::list names_of(const std::vector<std::string_view>& names) {
    nb::list made;
    for (const std::string_view name : names)
        made.append(str_of_name(name));
    return made;
}

/// The rows in the order of commits: of each the moving edges, then the static ones.
class RowTable {
public:
    explicit RowTable(const CommitSample& sample)
        : sample_(sample),
          names_(names_of(sample.names)),
          authors_(names_of(sample.authorities)),
          stamps_(new_stamps(sample.rows.size())),
          poses_(new_doubles({sample.rows.size(), 7})),
          statics_(new_flags(sample.rows.size())),
          commits_(new_stamps(sample.rows.size())) {
        for (const CommitSample::Commit& commit : sample.commits) {
            note_resets(commit);
            for (const bool is_static : {false, true}) {
                for (const CommitSample::Edge& edge : sample.edges_of(commit)) {
                    if (edge.is_static == is_static)
                        add(edge, commit.number);
                }
            }
        }
    }
    /// (row, commit, frames): the commit cleared or removed them before that row.
    [[nodiscard]] const nb::list& resets() const { return resets_; }
    [[nodiscard]] nb::tuple columns() const {
        return nb::make_tuple(parents_, children_, stamps_.array, poses_.array, statics_.array,
                              commits_.array, authorities_);
    }

private:
    void note_resets(const CommitSample::Commit& commit) {
        nb::list frames;
        for (const auto& range : {commit.cleared, commit.removed}) {
            for (const std::uint32_t place : sample_.names_of(range))
                frames.append(names_[place]);
        }
        if (nb::len(frames) != 0)
            resets_.append(nb::make_tuple(row_, commit.number, frames));
    }
    void add(const CommitSample::Edge& edge, CommitNumber commit) {
        for (const CommitSample::Row& row : sample_.rows_of(edge)) {
            parents_.append(names_[row.parent]);
            children_.append(names_[edge.child]);
            authorities_.append(authors_[edge.authority]);
            stamps_.data[row_] = row.stamp;
            statics_.data[row_] = edge.is_static;
            commits_.data[row_] = static_cast<StampNs>(commit);
            std::memcpy(poses_.data + 7 * row_, row.numbers.data(), sizeof(row.numbers));
            ++row_;
        }
    }

    const CommitSample& sample_;
    nb::list names_;
    nb::list authors_;
    NewArray<StampNs> stamps_;
    NewArray<double> poses_;
    NewArray<bool> statics_;
    NewArray<StampNs> commits_;
    nb::list parents_;
    nb::list children_;
    nb::list authorities_;
    nb::list resets_;
    std::size_t row_ = 0;
};

nb::tuple rows_of_commits(nb::handle data) {
    const BytesLike bytes(data, "data");
    CommitSample sample;
    {
        const LongWork work(true);
        sample.decode(bytes.bytes());
    }
    const RowTable table(sample);
    return nb::make_tuple(sample.last, table.columns(), table.resets());
}

/// Of a row: the object at `row` of one of its lists.
PyObject* item(nb::handle list, std::size_t row) {
    return PyList_GetItem(list.ptr(), static_cast<Py_ssize_t>(row));
}

/// A tuple of a subclass, without the arguments of its `__new__`.
nb::object named_tuple(nb::handle type, const nb::tuple& members) {
    const nb::object arguments = nb::steal(PyTuple_Pack(1, members.ptr()));
    return nb::steal(
        PyTuple_Type.tp_new(reinterpret_cast<PyTypeObject*>(type.ptr()), arguments.ptr(), nullptr));
}

nb::list samples_of_rows(const nb::list& parents, const nb::list& children, nb::handle stamps,
                         nb::handle poses, nb::handle statics, nb::handle commits,
                         const nb::list& authorities) {
    const auto stamp_view = ArrayView::of(stamps, false);
    const auto pose_view = ArrayView::of(poses, false);
    const auto static_view = ArrayView::of(statics, false);
    const auto commit_view = ArrayView::of(commits, false);
    const std::size_t count = nb::len(parents);
    for (const auto* view : {&stamp_view, &pose_view, &static_view, &commit_view}) {
        if (!*view || !(*view)->contiguous() || (*view)->extent(0) != count)
            throw InvalidArgument("rows must be those that rows_of_commits returned");
    }
    if (nb::len(children) != count || nb::len(authorities) != count)
        throw InvalidArgument("rows must be those that rows_of_commits returned");
    const nb::object type = nb::module_::import_("tfdb.data.types").attr("Sample");
    nb::list samples;
    for (std::size_t row = 0; row < count; ++row) {
        geometry::Pose pose;
        std::memcpy(&pose, pose_view->data<double>() + 7 * row, sizeof pose);
        const StampNs stamp = stamp_view->data<StampNs>()[row];
        const auto commit = static_cast<CommitNumber>(commit_view->data<StampNs>()[row]);
        nb::object transform =
            nb::steal(new_transform(pose, stamp, commit, {}, Py_NewRef(item(parents, row)),
                                    Py_NewRef(item(children, row)), nullptr));
        const nb::object at =
            static_view->data<bool>()[row] ? nb::object(nb::none()) : nb::object(nb::int_(stamp));
        samples.append(named_tuple(
            type, nb::make_tuple(transform, at, commit, nb::borrow(item(authorities, row)))));
    }
    return samples;
}

}  // namespace

void bind_sample_rows(nb::module_& module) {
    module.def(
        "rows_of_commits", &rows_of_commits, nb::arg("data"),
        nb::sig("def rows_of_commits(data: bytes) -> tuple[int, tuple[list[str], list[str], "
                "numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], "
                "numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.int64], "
                "list[str]], list[tuple[int, int, list[str]]]]"),
        "Read the samples in bytes of `commits_bytes` or `state_bytes`.\n\n"
        "Returns the last commit; parents, children, stamps, poses, which rows are static, "
        "commits and authorities; and, before a row, the frames that a commit cleared or removed.");
    module.def("samples_of_rows", &samples_of_rows, nb::arg("parents"), nb::arg("children"),
               nb::arg("stamps"), nb::arg("poses"), nb::arg("statics"), nb::arg("commits"),
               nb::arg("authorities"),
               nb::sig("def samples_of_rows(parents: list[str], children: list[str], stamps: "
                       "numpy.typing.NDArray[numpy.int64], poses: "
                       "numpy.typing.NDArray[numpy.float64], statics: "
                       "numpy.typing.NDArray[numpy.bool_], commits: "
                       "numpy.typing.NDArray[numpy.int64], authorities: list[str]) -> "
                       "list[tfdb.types.Sample]"),
               "The rows that `rows_of_commits` returned, each as a Sample.");
}

}  // namespace tfdb::python
