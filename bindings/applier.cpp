// Messages of one source, applied in the thread that brings them.
#include <chrono>
#include <exception>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>

#include "arguments.hpp"
#include "bytes_like.hpp"
#include "commits.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "signatures.hpp"
#include "writes.hpp"

namespace tfdb::python {
namespace {

/// The options of `apply`.
/// Threads: with the GIL. Guarantee: its texts live as long as it and the objects do.
class Options {
public:
    Options(nb::handle source, nb::handle prefix, nb::handle shared) : unprefixed_(shared) {
        options_.source = name_of(source, "source");
        options_.prefix = name_of(prefix, "prefix");
        options_.shared = unprefixed_.views();
        for (const std::string_view text : {options_.source, options_.prefix}) {
            if (text.size() > kMaxNameBytes) {
                throw InvalidArgument("source and prefix have at most 1024 bytes, not " +
                                      std::to_string(text.size()));
            }
        }
    }
    [[nodiscard]] const ApplyOptions& get() const { return options_; }

private:
    FrameNames unprefixed_;
    ApplyOptions options_;
};

/// Warns of each frame whose local parent was lost. Two sources of a shared frame may dispute it in
/// each commit: of such a frame it warns once.
void warn_of(LostParents lost, BufferObject& buffer, std::string_view source) {
    for (std::string& frame : lost.disputed) {
        if (buffer.warned.is_new(ErrorCode::kReadOnly, frame))
            lost.local.push_back(std::move(frame));
    }
    for (const std::string& frame : lost.local) {
        const nb::object text =
            escaped("frame '" + frame + "' lost the parent that was stored here: source '" +
                    std::string(source) +
                    "' stores another parent, or made the frame an ancestor of that one");
        const nb::object kind = nb::module_::import_("tfdb.data.errors").attr("TfdbWarning");
        if (PyErr_WarnFormat(kind.ptr(), 1, "%U", text.ptr()) != 0)
            throw nb::python_error();
    }
}

/// Applies a source's messages without Python code between the network and the store.
/// Threads: any, with the GIL. Guarantee: one thread at a time applies.
class ApplierObject {
public:
    ApplierObject(nb::object buffer, nb::handle source, nb::handle prefix, nb::handle shared)
        : owner_(std::move(buffer)),
          buffer_(object_of<BufferObject>(owner_)),
          source_(name_of(source, "source")),
          applier_(buffer_.open_store(), Options(source, prefix, shared).get()) {}

    nb::object apply(nb::handle data) {
        const BytesLike bytes(data, "data");
        Done done;
        {
            const LongWork work(true);
            const std::lock_guard guard(lock_);
            done = try_apply(bytes.bytes());
        }
        warn_of(std::move(done.lost), buffer_, source_);
        if (done.error)
            std::rethrow_exception(done.error);
        return position_record(done.position);
    }
    bool take(nb::handle data) {
        keep_thread_state();
        const BytesLike bytes(data, "data");
        const std::string_view text(reinterpret_cast<const char*>(bytes.bytes().data()),
                                    bytes.bytes().size());
        if (front_.empty() || !text.starts_with(front_))
            return false;
        Done done;
        {
            const LongWork work(true);
            const std::unique_lock guard(lock_, std::try_to_lock);
            if (!guard.owns_lock())
                return false;
            done = try_apply(bytes.bytes());
        }
        warn_of(std::move(done.lost), buffer_, source_);
        if (done.error)
            return false;
        bytes_ += text.size();
        taken_at_ = std::chrono::steady_clock::now();
        return true;
    }
    void follow(nb::handle front) {
        front_.clear();
        if (!front.is_none()) {
            const BytesLike bytes(front, "front");
            front_.assign(reinterpret_cast<const char*>(bytes.bytes().data()),
                          bytes.bytes().size());
        }
    }
    nb::object taken() {
        if (bytes_ == 0)
            return nb::none();
        const std::chrono::duration<double> at = taken_at_.time_since_epoch();
        return nb::make_tuple(std::exchange(bytes_, 0), at.count());
    }
    [[nodiscard]] nb::object position() {
        const auto found = applier_.position();
        return found && found->epoch != Epoch{} ? position_record(*found) : nb::none();
    }

    [[nodiscard]] nb::handle owner() const { return owner_; }

private:
    struct Done {
        Position position;
        std::exception_ptr error;
        LostParents lost;
    };
    /// Under the lock, without the GIL.
    Done try_apply(Bytes bytes) {
        Done done;
        try {
            (void)buffer_.open_store();
            done.position = applier_.apply(bytes);
        } catch (const Error&) {
            done.error = std::current_exception();
        }
        done.lost = applier_.take_lost();
        return done;
    }

    nb::object owner_;
    BufferObject& buffer_;
    std::string source_;
    std::mutex lock_;  // of `applier_.apply`; the GIL is of the rest
    Applier applier_;
    std::string front_;
    std::uint64_t bytes_ = 0;
    std::chrono::steady_clock::time_point taken_at_;
};

nb::object apply(nb::object buffer, nb::handle data, nb::handle source, nb::handle prefix,
                 nb::handle shared) {
    return ApplierObject(std::move(buffer), source, prefix, shared).apply(data);
}

// The buffer may refer to objects that hold the applier.
int traverse_applier(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (nb::inst_ready(self))
        Py_VISIT(nb::inst_ptr<ApplierObject>(self)->owner().ptr());
    return 0;
}

PyType_Slot g_applier_slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse_applier)},
    {0, nullptr},
};

constexpr const char* kApplyDoc =
    R"(Apply commits or a state of another store, from `commits_bytes` or `state_bytes`.

Each commit becomes one commit here. A state becomes one commit, which replaces all that the source
had stored: no reader sees an empty or a mixed store. The same commit stores the position, so
`positions()` shows where to continue after a kill. Commits at or before the position are skipped.

Frames of a source are read-only for all other writers (ReadOnly) until `forget_source`. An
exception: any writer may give a parent to a frame that is a root at its source. This parent is kept
until the source itself gives the frame one, with a TfdbWarning. If the source removes a frame with
a child of another writer, the frame stays, without samples.

Parameters
----------
data
    The bytes.
prefix
    Text before the name of each frame, such as `robot1/`. It is fixed by the first call, and must
    not be the beginning of another source's prefix.
shared
    Frames that get no prefix, such as `map`. Give the same ones with every call; a state may be
    applied with others.
source
    Name of the other store in this one.

Returns
-------
Position
    How far the source's commits are applied: pass its `commit` to `commits_bytes`.

Raises
------
OutOfOrder
    Commits before these are missing, or they are of a later epoch, or the position was reached
    with other frames (`frames` of `commits_bytes` and `state_bytes`, or `shared`): apply a state
    first.
Fenced
    They are of an epoch that has ended. If the clock of the source was set back, call
    `forget_source`, then apply a state.
CorruptMessage
    The bytes are damaged, cut short, or of another version; `offset` is the byte.
InvalidName, InvalidTransform, InvalidStamp, CycleError, FrameInUse
    The data cannot be stored. InvalidTransform also if a commit stores an edge twice.
InvalidArgument
    The prefix is not the one of the first call, or it overlaps another source's.
CapacityExceeded, ReadOnly, LockTimeout, NotSupported, TransactionActive
    As a write raises them.

The commits before the refused one are applied; it and later ones are not.)";

}  // namespace

void bind_applier(nb::module_& module, nb::class_<BufferObject, StoreReaderObject>& type) {
    auto made = nb::class_<ApplierObject>(module, "Applier", "Applies messages of one source.",
                                          nb::type_slots(g_applier_slots));
    refuse_construction<ApplierObject>(made, "Buffer._applier() makes appliers");
    made.def("apply", &ApplierObject::apply, nb::arg("data"),
             nb::sig("def apply(self, data: bytes) -> tfdb.types.Position"),
             "Apply commits or a state, as Buffer.apply does.");
    made.def("take", &ApplierObject::take, nb::arg("data"),
             nb::sig("def take(self, data: bytes) -> bool"),
             "Apply commits that begin as `follow` demands, without waiting for `apply`.\n\n"
             "Returns False if not all of them are applied: `apply` then raises the reason.");
    made.def("follow", &ApplierObject::follow, nb::arg("front").none(),
             nb::sig("def follow(self, front: bytes | None) -> None"),
             "Set how bytes begin that `take` applies. None: it applies none.");
    made.def("taken", &ApplierObject::taken, nb::sig("def taken(self) -> tuple[int, float] | None"),
             "Return the bytes that `take` has applied since the last call, and the time.\n\n"
             "The time is of the last ones, in seconds as of time.monotonic(). None: nothing.");
    made.def_prop_ro("position", &ApplierObject::position,
                     nb::sig("def position(self) -> tfdb.types.Position | None"),
                     "The source's position in the store. None: nothing was applied.");
    type.def("apply", &apply, nb::arg("data").none(), nb::kw_only(), nb::arg("source").none() = "",
             nb::arg("prefix").none() = "", nb::arg("shared").none() = nb::make_tuple(),
             nb::sig("def apply(self, data: bytes, *, source: str = '', prefix: str = '', "
                     "shared: str | collections.abc.Iterable[str] = ()) -> tfdb.types.Position"),
             kApplyDoc);
    type.def(
        "_applier",
        [](nb::object self, nb::handle source, nb::handle prefix, nb::handle shared) {
            return new ApplierObject(std::move(self), source, prefix, shared);
        },
        nb::arg("source").none(), nb::arg("prefix").none(), nb::arg("shared").none(),
        nb::sig("def _applier(self, source: str, prefix: str, "
                "shared: collections.abc.Iterable[str]) -> Applier"),
        "Return an object that applies messages of one source.");
}

}  // namespace tfdb::python
