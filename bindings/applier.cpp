// Messages of one source, applied in the thread that brings them.
#include <chrono>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "bytes_like.hpp"
#include "commits.hpp"
#include "reads.hpp"
#include "signatures.hpp"

namespace tfdb::python {
namespace {

/// Applies a source's messages without Python code between the network and the store.
/// Threads: any, with the GIL. Guarantee: one thread at a time applies.
class ApplierObject {
public:
    ApplierObject(nb::object buffer, nb::handle source, nb::handle prefix, nb::handle shared)
        : owner_(std::move(buffer)),
          buffer_(object_of<BufferObject>(owner_)),
          source_(name_of(source, "source")),
          applier_(buffer_.open_store(), AppliedOptions(source, prefix, shared).get()) {}

    nb::object apply(nb::handle data) {
        const BytesLike bytes(data, "data");
        Applied applied;
        {
            const LongWork work(true);
            const std::lock_guard guard(lock_);
            (void)buffer_.open_store();
            applied = applier_.apply(bytes.bytes());
        }
        nb::object position = position_record(applied.position);
        warn_of_lost(buffer_, std::move(applied), source_);
        return position;
    }
    bool take(nb::handle data) {
        keep_thread_state();
        const BytesLike bytes(data, "data");
        const std::string_view text(reinterpret_cast<const char*>(bytes.bytes().data()),
                                    bytes.bytes().size());
        if (front_.empty() || !text.starts_with(front_))
            return false;
        std::optional<Applied> applied;
        {
            const LongWork work(true);
            const std::unique_lock guard(lock_, std::try_to_lock);
            if (guard.owns_lock())
                applied = try_apply(bytes.bytes());
        }
        if (!applied)
            return false;
        bytes_ += text.size();
        taken_at_ = std::chrono::steady_clock::now();
        warn_of_lost(buffer_, *std::move(applied), source_);
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
    /// None: `apply` of the same bytes raises the reason.
    std::optional<Applied> try_apply(Bytes bytes) {
        try {
            (void)buffer_.open_store();
            return applier_.apply(bytes);
        } catch (const Error&) {
            return std::nullopt;
        }
    }

    nb::object owner_;
    BufferObject& buffer_;
    std::string source_;
    std::mutex lock_;  // of `applier_.apply`
    Applier applier_;
    std::string front_;
    std::uint64_t bytes_ = 0;
    std::chrono::steady_clock::time_point taken_at_;
};

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
