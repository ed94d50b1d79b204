// Samples of commits as rows of one table and as records: for streams.
#include <array>
#include <cstddef>
#include <cstring>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "arrays.hpp"
#include "bytes_like.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "records.hpp"
#include "tfdb/wire/commit_sample.hpp"
#include "transform.hpp"

// After Python.h, on which it depends.
#include <structmember.h>

namespace tfdb::python {
namespace {

using wire::CommitSample;

nb::list names_of(const std::vector<std::string_view>& names) {
    nb::list made;
    for (const std::string_view name : names)
        made.append(str_of_name(name));
    return made;
}

/// The rows in commit order: for each commit the moving edges, then the static ones.
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
    /// (row, commit, frames): before that row, the commit cleared or removed the frames.
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

// -- rows as samples ----------------------------------------------------------------------------

nb::object checked(PyObject* made) {
    if (made == nullptr)
        throw nb::python_error();
    return nb::steal(made);
}

/// The columns returned by `rows_of_commits`: each row becomes a Sample.
/// Threads: the holder of the GIL; without a GIL, any. Guarantee: immutable.
class SampleRows {
public:
    /// Throws InvalidArgument.
    SampleRows(nb::handle parents, nb::handle children, nb::handle stamps, nb::handle poses,
               nb::handle statics, nb::handle commits, nb::handle authorities)
        : count_(nb::len(parents)),
          parents_(list_of(parents)),
          children_(list_of(children)),
          authorities_(list_of(authorities)),
          stamps_(view_of(stamps)),
          poses_(view_of(poses)),
          statics_(view_of(statics)),
          commits_(view_of(commits)),
          type_(record_type("Sample")),
          make_(reinterpret_cast<newfunc>(PyType_GetSlot(&PyTuple_Type, Py_tp_new))) {}

    [[nodiscard]] Py_ssize_t size() const { return static_cast<Py_ssize_t>(count_); }
    [[nodiscard]] StampNs commit(Py_ssize_t row) const { return commits_.data<StampNs>()[row]; }
    [[nodiscard]] nb::object sample(Py_ssize_t row) const {
        geometry::Pose pose;
        std::memcpy(&pose, poses_.data<double>() + 7 * row, sizeof pose);
        const StampNs stamp = stamps_.data<StampNs>()[row];
        const StampNs commit = commits_.data<StampNs>()[row];
        const nb::object transform =
            checked(new_transform(pose, stamp, static_cast<CommitNumber>(commit), {},
                                  item(parents_, row), item(children_, row), nullptr));
        const nb::object number = checked(PyLong_FromLongLong(commit));
        const nb::object at = statics_.data<bool>()[row] ? nb::object(nb::none())
                                                         : checked(PyLong_FromLongLong(stamp));
        const nb::object members = checked(
            PyTuple_Pack(4, transform.ptr(), at.ptr(), number.ptr(), item(authorities_, row)));
        const nb::object arguments = checked(PyTuple_Pack(1, members.ptr()));
        // Created as tuples are: without the arguments of the class's own `__new__`.
        return checked(
            make_(reinterpret_cast<PyTypeObject*>(type_.ptr()), arguments.ptr(), nullptr));
    }

private:
    [[noreturn]] static void refuse() {
        throw InvalidArgument("rows must be those that rows_of_commits returned");
    }
    [[nodiscard]] nb::list list_of(nb::handle column) const {
        if (PyList_Check(column.ptr()) == 0 || nb::len(column) != count_)
            refuse();
        return nb::borrow<nb::list>(column);
    }
    [[nodiscard]] ArrayView view_of(nb::handle column) const {
        std::optional<ArrayView> view = ArrayView::of(column, false);
        if (!view || !view->contiguous() || view->extent(0) != count_)
            refuse();
        return std::move(*view);
    }
    [[nodiscard]] static PyObject* item(const nb::list& column, Py_ssize_t row) {
        return PyList_GetItem(column.ptr(), row);
    }

    std::size_t count_;
    nb::list parents_;
    nb::list children_;
    nb::list authorities_;
    ArrayView stamps_;
    ArrayView poses_;
    ArrayView statics_;
    ArrayView commits_;
    nb::object type_;
    newfunc make_;
};

/// The native part of a Stream, whose Python methods access the members under the lock.
/// Threads: any, with the GIL if there is one. Guarantee: `__next__` takes no row while another
/// thread has the lock.
struct StreamRowsObject {
    PyObject_HEAD PyObject* lock;
    std::shared_ptr<const SampleRows> rows;  // null: none were read
    Py_ssize_t next;                         // the next row
    char has_read;
    char ended;
};

StreamRowsObject& stream_of(PyObject* self) {
    return *reinterpret_cast<StreamRowsObject*>(self);
}

PyObject* g_locked = nullptr;
PyObject* g_acquire = nullptr;
PyObject* g_release = nullptr;
PyObject* g_next_slowly = nullptr;

#ifdef Py_GIL_DISABLED

/// Holds a Python lock during its lifetime, unless another thread has it.
/// Threads: one. Guarantee: waits for nothing.
class Turn {
public:
    explicit Turn(PyObject* lock) : lock_(nb::borrow(lock)) {
        std::array<PyObject*, 2> all{lock, Py_False};
        has_it_ = checked(PyObject_VectorcallMethod(g_acquire, all.data(), all.size(), nullptr))
                      .is(nb::handle(Py_True));
    }
    ~Turn() {
        PyObject* const lock = lock_.ptr();
        if (has_it_)
            Py_XDECREF(PyObject_VectorcallMethod(g_release, &lock, 1, nullptr));
    }
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;

    [[nodiscard]] explicit operator bool() const { return has_it_; }

private:
    nb::object lock_;
    bool has_it_ = false;
};

#else

/// Whether a Python lock is free: no thread takes it while the caller keeps the GIL.
/// Threads: the holder of the GIL. Guarantee: waits for nothing.
class Turn {
public:
    explicit Turn(PyObject* lock)
        : has_it_(checked(PyObject_VectorcallMethod(g_locked, &lock, 1, nullptr))
                      .is(nb::handle(Py_False))) {}

    [[nodiscard]] explicit operator bool() const { return has_it_; }

private:
    bool has_it_;
};

#endif

PyObject* next_sample(PyObject* self) {
    return guarded([&]() -> PyObject* {
        StreamRowsObject& stream = stream_of(self);
        std::shared_ptr<const SampleRows> rows;
        Py_ssize_t row = 0;
        if (stream.lock != nullptr) {
            const Turn turn(stream.lock);
            const nb::ft_object_guard guard(self);
            if (turn && stream.ended == 0 && stream.rows && stream.next < stream.rows->size()) {
                rows = stream.rows;
                row = stream.next++;
                stream.has_read = 1;
            }
        }
        if (rows)
            return rows->sample(row).release().ptr();
        return PyObject_CallMethodObjArgs(self, g_next_slowly, nullptr);
    });
}

PyObject* set_rows(PyObject* self, PyObject* const* args, Py_ssize_t count) {
    return guarded([&]() -> PyObject* {
        if (count != 8)
            throw nb::type_error("_set_rows takes the columns of rows_of_commits, and a row");
        // The old rows are released last: that may run any code.
        auto rows = std::make_shared<const SampleRows>(args[0], args[1], args[2], args[3], args[4],
                                                       args[5], args[6]);
        const Py_ssize_t next = PyNumber_AsSsize_t(args[7], PyExc_IndexError);
        if (next == -1 && PyErr_Occurred() != nullptr)
            throw nb::python_error();
        const nb::ft_object_guard guard(self);
        stream_of(self).rows.swap(rows);
        stream_of(self).next = next;
        return Py_NewRef(Py_None);
    });
}

/// Needs no lock, so that it waits for no reading thread.
PyObject* commit_of_next(PyObject* self, PyObject* /*unused*/) {
    return guarded([&]() -> PyObject* {
        const StreamRowsObject& stream = stream_of(self);
        const nb::ft_object_guard guard(self);
        if (stream.rows == nullptr || stream.next >= stream.rows->size())
            return Py_NewRef(Py_None);
        return PyLong_FromLongLong(stream.rows->commit(stream.next));
    });
}

PyObject* sample_of_row(PyObject* self, PyObject* row) {
    return guarded([&]() -> PyObject* {
        const std::shared_ptr<const SampleRows> rows = stream_of(self).rows;
        const Py_ssize_t wanted = PyNumber_AsSsize_t(row, PyExc_IndexError);
        if (wanted == -1 && PyErr_Occurred() != nullptr)
            throw nb::python_error();
        if (rows == nullptr || wanted < 0 || wanted >= rows->size())
            throw nb::index_error("no such row");
        return rows->sample(wanted).release().ptr();
    });
}

PyObject* new_stream(PyTypeObject* type, PyObject* /*args*/, PyObject* /*keywords*/) {
    PyObject* const self = PyType_GenericAlloc(type, 0);
    if (self != nullptr)
        new (&stream_of(self).rows) std::shared_ptr<const SampleRows>();
    return self;
}

int traverse_stream(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    Py_VISIT(stream_of(self).lock);
    return 0;
}

int clear_stream(PyObject* self) {
    Py_CLEAR(stream_of(self).lock);
    return 0;
}

void deallocate_stream(PyObject* self) {
    PyTypeObject* const type = Py_TYPE(self);
    PyObject_GC_UnTrack(self);
    clear_stream(self);
    stream_of(self).rows.~shared_ptr();
    PyObject_GC_Del(self);
    Py_DECREF(type);
}

PyMemberDef g_stream_members[] = {
    {"_lock", T_OBJECT, offsetof(StreamRowsObject, lock), 0, nullptr},
    {"_next", T_PYSSIZET, offsetof(StreamRowsObject, next), 0, nullptr},
    {"_has_read", T_BOOL, offsetof(StreamRowsObject, has_read), 0, nullptr},
    {"_ended", T_BOOL, offsetof(StreamRowsObject, ended), 0, nullptr},
    {nullptr, 0, 0, 0, nullptr},
};

PyMethodDef g_stream_methods[] = {
    {"_set_rows", reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(set_rows)),
     METH_FASTCALL,
     "_set_rows($self, /, *columns)\n--\n\nHold the columns that `rows_of_commits` returned, and "
     "set the next row."},
    {"_commit_of_next", commit_of_next, METH_NOARGS,
     "_commit_of_next($self, /)\n--\n\nReturn the commit of the next row; None: all were read."},
    {"_sample", sample_of_row, METH_O,
     "_sample($self, row, /)\n--\n\nReturn a row of those as a Sample."},
    {nullptr, nullptr, 0, nullptr},
};

PyType_Slot g_stream_slots[] = {
    {Py_tp_new, reinterpret_cast<void*>(new_stream)},
    {Py_tp_traverse, reinterpret_cast<void*>(traverse_stream)},
    {Py_tp_clear, reinterpret_cast<void*>(clear_stream)},
    {Py_tp_dealloc, reinterpret_cast<void*>(deallocate_stream)},
    {Py_tp_iternext, reinterpret_cast<void*>(next_sample)},
    {Py_tp_members, g_stream_members},
    {Py_tp_methods, g_stream_methods},
    {Py_tp_doc, const_cast<char*>("The native part of `Stream`: the rows that it has read, and "
                                  "the next one.")},
    {0, nullptr},
};

PyType_Spec g_stream_spec = {
    "tfdb._core.StreamRows",
    sizeof(StreamRowsObject),
    0,
    Py_TPFLAGS_DEFAULT | Py_TPFLAGS_BASETYPE | Py_TPFLAGS_HAVE_GC,
    g_stream_slots,
};

PyObject* interned(const char* name) {
    return checked(PyUnicode_InternFromString(name)).release().ptr();
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
    g_locked = interned("locked");
    g_acquire = interned("acquire");
    g_release = interned("release");
    g_next_slowly = interned("_next_slowly");
    module.attr("StreamRows") = checked(PyType_FromSpec(&g_stream_spec));
}

}  // namespace tfdb::python
