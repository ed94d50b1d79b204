// Converts between TFMessage bytes and Python.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <unordered_map>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "arrays.hpp"
#include "arrivals.hpp"
#include "bytes_like.hpp"
#include "errors.hpp"
#include "recorded.hpp"
#include "records.hpp"
#include "rewriting.hpp"
#include "selection.hpp"
#include "tfdb/wire/tf_message.hpp"
#include "writes.hpp"

namespace tfdb::python {
namespace {

/// Stores the valid transforms of a message, in one commit.
/// Threads: one, with the GIL; the constructor's arguments outlive it.
class OneMessage {
public:
    OneMessage(BufferObject& buffer, nb::handle data, nb::handle encoding, bool is_static,
               nb::handle authority, WriteRules rules)
        : buffer_(buffer),
          message_(data),
          is_static_(is_static),
          authority_(name_of(authority, "authority")),
          rules_(rules) {
        wire::decode_tf_message(message_.bytes(), encoding_of(encoding), transforms);
    }

    /// Returns the refused members. Throws errors that concern no member, such as CapacityExceeded;
    /// with `throw_if_none` also the error of a message without a valid member.
    std::vector<RefusedMember> store(bool throw_if_none) {
        WriteRequest request{.transforms = transforms,
                             .is_static = is_static_,
                             .authority = authority_,
                             .rules = rules_};
        try {
            commit = commit_write(buffer_, request);
            return {};
        } catch (const Error& error) {
            const std::size_t refused = error.detail().refused.size();
            if (refused == 0 || (throw_if_none && refused == transforms.size()))
                throw;
        }
        request.partial = true;
        const LongWork work(true);
        WriteResult result = buffer_.open_store().write(request);
        commit = result.commit;
        return std::move(result.refused);
    }

    std::vector<TransformView> transforms;
    CommitNumber commit = 0;

private:
    BufferObject& buffer_;
    const BytesLike message_;
    const bool is_static_;
    const std::string_view authority_;
    const WriteRules rules_;
};

/// The child frame of a refused member; it may be any text.
std::string edge_of(const TransformView& refused) {
    return std::string(refused.child.substr(0, kMaxNameBytes));
}

CommitNumber ingest(BufferObject& self, nb::handle data, nb::handle encoding, bool is_static,
                    nb::handle authority, bool change_kind, bool only_new) {
    OneMessage message(self, data, encoding, is_static, authority, {change_kind, only_new});
    for (const RefusedMember& member : message.store(true)) {
        const TransformView& transform = message.transforms[member.index];
        if (!self.warned.is_new(member.code, edge_of(transform)))
            continue;
        const nb::object text =
            escaped(std::string(class_name(member.code)) + ": " + member.message);
        const nb::object kind = nb::module_::import_("tfdb.data.errors").attr("TfdbWarning");
        if (PyErr_WarnFormat(kind.ptr(), 1, "%U; the rest of its message is stored", text.ptr()) !=
            0) {
            throw nb::python_error();
        }
    }
    return message.commit;
}

nb::list ingest_members(BufferObject& self, nb::handle data, nb::handle encoding, bool is_static,
                        nb::handle authority, bool change_kind, bool only_new) {
    OneMessage message(self, data, encoding, is_static, authority, {change_kind, only_new});
    nb::list records;
    for (const RefusedMember& member : message.store(false))
        records.append(refused_record(member));
    return records;
}

/// The sender of each of many messages: one name for all, or one name each. Constructed with the
/// GIL.
class Senders {
public:
    Senders(nb::handle authority, nb::handle messages) {
        if (PyUnicode_Check(authority.ptr())) {
            common_ = name_of(authority.ptr(), "authority");
            return;
        }
        check_many(authority, "authority", "a str, or one for each message");
        names_ = nb::steal<nb::object>(PySequence_Tuple(authority.ptr()));
        if (!names_.is_valid()) {
            throw nb::python_error();
        }
        const Py_ssize_t count = PyObject_Length(messages.ptr());
        forget_error();
        if (count != NB_TUPLE_GET_SIZE(names_.ptr())) {
            throw_error("InvalidArgument",
                        "authority must be one name, or one for each of a sequence of messages",
                        {{"value", nb::borrow(authority)}});
        }
        for (Py_ssize_t i = 0; i < count; ++i) {
            each_.push_back(name_of(NB_TUPLE_GET_ITEM(names_.ptr(), i), "authority"));
        }
    }

    /// Valid as long as the constructor's arguments.
    [[nodiscard]] std::string_view of(std::size_t message) const {
        return message < each_.size() ? each_[message] : common_;
    }

private:
    nb::object names_;
    std::vector<std::string_view> each_;
    std::string_view common_;
};

struct Refusal {
    std::uint64_t count = 0;
    std::uint64_t index = 0;
    std::string first;

    void add(std::uint64_t message, std::string_view text) {
        if (count++ == 0) {
            index = message;
            first = text;
        }
    }
};

/// Totals of an ingest_many call. Threads: one.
struct Tally {
    std::uint64_t messages = 0;
    std::uint64_t transforms = 0;
    std::uint64_t commits = 0;
    std::uint64_t refused = 0;
    std::uint64_t refused_transforms = 0;
    CommitNumber commit = 0;
    std::map<ErrorCode, Refusal> reasons;
    /// By the child frame, the error, and whether it concerns a whole message.
    std::map<std::tuple<std::string, ErrorCode, bool>, Refusal> edges;

    void add_message(ErrorCode code, std::string_view text) {
        reasons[code].add(messages, text);
        edges[{std::string(), code, true}].add(messages, text);
    }

    void add_member(std::string edge, ErrorCode code, std::string_view text) {
        reasons[code].add(messages, text);
        edges[{std::move(edge), code, false}].add(messages, text);
    }
};

/// Counts a message's samples that the store stored or refused as too old.
void count_forgotten(Forgotten& forgotten, std::span<const TransformView> members,
                     std::span<const RefusedMember> refused) {
    for (std::size_t i = 0; i < members.size(); ++i) {
        if (refused.empty() || refused.front().index != i) {
            forgotten.stored(members[i].child, members[i].stamp);
            continue;
        }
        if (refused.front().code == ErrorCode::kTooOld)
            forgotten.refused();
        refused = refused.subspan(1);
    }
}

/// `select` reduces the members of a message to those to be stored.
template <class Select>
void ingest_one(Buffer& store, Bytes bytes, wire::Encoding encoding, bool is_static,
                std::string_view authority, std::vector<TransformView>& scratch, Tally& tally,
                Forgotten* forgotten, Select select) {
    try {
        wire::decode_tf_message(bytes, encoding, scratch);
        select(scratch);
        const WriteResult result = store.write({.transforms = scratch,
                                                .is_static = is_static,
                                                .authority = authority,
                                                .partial = true});
        tally.commit = result.commit;
        const auto& refused = result.refused;
        const std::size_t stored = scratch.size() - refused.size();
        tally.transforms += stored;
        tally.commits += stored == 0 ? 0 : 1;
        tally.refused += stored == 0 && !refused.empty() ? 1 : 0;
        tally.refused_transforms += refused.size();
        for (const RefusedMember& member : refused)
            tally.add_member(edge_of(scratch[member.index]), member.code, member.message);
        if (forgotten != nullptr && !is_static)
            count_forgotten(*forgotten, scratch, refused);
    } catch (const TransactionActive&) {
        throw;
    } catch (const Forked&) {
        throw;
    } catch (const ReadOnly&) {
        throw;
    } catch (const LockTimeout&) {
        throw;
    } catch (const Error& error) {
        ++tally.refused;
        tally.add_message(error.code(), error.what());
    }
    ++tally.messages;
}

nb::object result_of(const Tally& tally) {
    const nb::object refusal_type = record_type("Refusal");
    nb::dict reasons;
    for (const auto& [code, refusal] : tally.reasons) {
        reasons[class_name(code)] =
            refusal_type(refusal.count, refusal.index, escaped(refusal.first));
    }
    const nb::object edge_type = record_type("RefusedEdge");
    nb::list edges;
    for (const auto& [key, refusal] : tally.edges) {
        const auto& [edge, code, is_message] = key;
        edges.append(edge_type(escaped(edge), class_name(code), refusal.count,
                               escaped(refusal.first), is_message));
    }
    return record_type("IngestResult")(tally.messages, tally.transforms, tally.commits,
                                       tally.refused, tally.commit, reasons,
                                       tally.refused_transforms, nb::tuple(edges));
}

nb::object ingest_many(BufferObject& self, nb::handle messages, nb::handle encoding, bool is_static,
                       nb::handle authority) {
    constexpr std::size_t kChunk = 1024;
    const auto keep_all = [](const std::vector<TransformView>&) {};
    const wire::Encoding how = encoding_of(encoding);
    const Senders senders(authority, messages);
    check_many(messages, "messages", "bytes-like objects, one for each message");
    const nb::object iterator = nb::steal(PyObject_GetIter(messages.ptr()));
    if (!iterator.is_valid()) {
        throw nb::python_error();
    }
    std::vector<TransformView> scratch;
    std::vector<BytesLike> chunk;
    Tally tally;
    tally.commit = self.open_store().commit();
    for (bool more = true; more;) {
        chunk.clear();
        look_for_signals(0);
        while (chunk.size() < kChunk) {
            const nb::object item = nb::steal(PyIter_Next(iterator.ptr()));
            if (!item.is_valid()) {
                more = false;
                break;
            }
            chunk.emplace_back(item);
        }
        if (PyErr_Occurred() != nullptr) {
            throw nb::python_error();
        }
        const LongWork work(true);
        for (const BytesLike& message : chunk) {
            ingest_one(self.open_store(), message.bytes(), how, is_static,
                       senders.of(tally.messages), scratch, tally, nullptr, keep_all);
        }
    }
    return result_of(tally);
}

/// The senders' names, by source. Valid as long as the dict.
std::map<std::uint32_t, std::string_view> senders_of(const nb::dict& authorities) {
    std::map<std::uint32_t, std::string_view> names;
    for (const auto& [source, name] : authorities) {
        names[nb::cast<std::uint32_t>(source)] = name_of(name.ptr(), "authority");
    }
    return names;
}

nb::object ingest_recorded(BufferObject& self, const Recorded& messages, std::size_t first,
                           std::size_t last, nb::handle encoding, bool is_static,
                           const nb::dict& authorities, nb::handle selection, const nb::dict& rules,
                           nb::handle forgotten) {
    constexpr std::size_t kTogether = 1024;
    const wire::Encoding how = encoding_of(encoding);
    const auto senders = senders_of(authorities);
    SelectedSources selected(selection, rules);
    Forgotten* const counter = forgotten_of(forgotten);
    std::vector<TransformView> scratch;
    Tally tally;
    tally.commit = self.open_store().commit();
    while (first < last) {
        look_for_signals(0);
        // A copy: other threads may add messages meanwhile. The bytes do not move.
        const std::vector<RecordedMessage> together =
            messages.between(first, std::min(last, first + kTogether));
        const LongWork work(true);
        for (const RecordedMessage& message : together) {
            const auto sender = senders.find(message.source);
            ingest_one(self.open_store(), message.bytes(), how, is_static,
                       sender == senders.end() ? std::string_view() : sender->second, scratch,
                       tally, counter, [&](std::vector<TransformView>& members) {
                           selected.apply(message.source, is_static, members);
                       });
        }
        first += kTogether;
    }
    return result_of(tally);
}

/// Adds the messages at [first, last) to a survey.
void survey_recorded(nb::handle survey, const Recorded& messages, std::size_t first,
                     std::size_t last, nb::handle encoding, bool is_static, nb::handle selection,
                     const nb::dict& rules) {
    constexpr std::size_t kTogether = 1024;
    const wire::Encoding how = encoding_of(encoding);
    SelectedSources selected(selection, rules);
    auto& found = nb::cast<EdgeSurvey&>(survey);
    std::vector<TransformView> scratch;
    for (; first < last; first += kTogether) {
        look_for_signals(0);
        const std::vector<RecordedMessage> together =
            messages.between(first, std::min(last, first + kTogether));
        const LongWork work(true);
        for (const RecordedMessage& message : together) {
            try {
                wire::decode_tf_message(message.bytes(), how, scratch);
            } catch (const CorruptMessage&) {
                continue;
            }
            selected.apply(message.source, is_static, scratch);
            found.add(scratch, is_static);
        }
    }
}

bool has_nul(std::string_view name) {
    return name.find('\0') != std::string_view::npos;
}

/// The first and last stamp of an edge.
struct Stamps {
    clock::StampNs first = 0;
    clock::StampNs last = 0;
};

/// The child frames in messages, by source, with their first and last stamp. Damaged messages and
/// transforms without a stamp do not count.
nb::dict recorded_children(const Recorded& messages, std::size_t first, std::size_t last,
                           nb::handle encoding, bool is_static, nb::handle selection,
                           const nb::dict& rules) {
    constexpr std::size_t kTogether = 1024;
    const wire::Encoding how = encoding_of(encoding);
    SelectedSources selected(selection, rules);
    // Views of bytes that do not move while `messages` and `selection` live.
    std::map<std::uint32_t, std::unordered_map<std::string_view, Stamps>> found;
    std::vector<TransformView> scratch;
    for (; first < last; first += kTogether) {
        look_for_signals(0);
        const std::vector<RecordedMessage> together =
            messages.between(first, std::min(last, first + kTogether));
        const LongWork work(true);
        for (const RecordedMessage& message : together) {
            auto& children = found[message.source];
            try {
                wire::decode_tf_message(message.bytes(), how, scratch);
            } catch (const CorruptMessage&) {
                continue;
            }
            selected.apply(message.source, is_static, scratch);
            for (const TransformView& transform : scratch) {
                const clock::StampNs stamp = transform.stamp;
                if (stamp < 0)
                    continue;
                const auto [at, is_new] =
                    children.try_emplace(transform.child, Stamps{stamp, stamp});
                if (!is_new) {
                    at->second.first = std::min(at->second.first, stamp);
                    at->second.last = std::max(at->second.last, stamp);
                }
            }
        }
    }
    nb::dict result;
    for (const auto& [source, children] : found) {
        nb::dict ranges;
        for (const auto& [child, stamps] : children) {
            if (has_nul(child))
                continue;  // the store refuses it
            const nb::object name = nb::steal(
                PyUnicode_DecodeUTF8(child.data(), static_cast<Py_ssize_t>(child.size()), nullptr));
            if (name.is_valid()) {
                ranges[name] = nb::make_tuple(stamps.first, stamps.last);
            } else {
                forget_error();  // the store refuses it
            }
        }
        result[nb::int_(source)] = ranges;
    }
    return result;
}

wire::Encoding encoding_or_cdr(PyObject* given) {
    return given == nullptr ? encoding_of(nb::str("cdr")) : encoding_of(given);
}

constexpr std::array<std::string_view, 2> kEncodeNames = {"transforms", "encoding"};
constexpr std::array<std::string_view, 2> kDecodeNames = {"data", "encoding"};

PyObject* encode(PyObject* /*self*/, PyObject* const* args, Py_ssize_t count, PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"encode_tf_message", kEncodeNames, 1, 2};
        const auto [transforms, encoding] = bind<2>(kList, args, count, keywords);
        const Transforms read = Transforms::for_message(transforms);
        std::vector<std::byte> out;
        wire::encode_tf_message(read.views, encoding_or_cdr(encoding), out);
        return nb::bytes(out.data(), out.size()).release().ptr();
    });
}

/// A frame name as a str; invalid if no TransformStamped can have the name.
nb::object text_of(std::string_view name) {
    if (has_nul(name))
        return {};
    nb::object text =
        nb::steal(PyUnicode_DecodeUTF8(name.data(), static_cast<Py_ssize_t>(name.size()), nullptr));
    if (!text.is_valid())
        forget_error();
    return text;
}

/// The error of a store that gets the transform.
nb::object error_of(const TransformView& view, std::size_t index, bool is_static,
                    std::string_view authority) {
    const std::optional<Error> fault = fault_of(view, index, is_static, authority);
    nb::object error = error_object(*fault);
    nb::setattr(error, "edge", escaped(edge_of(view)));
    return error;
}

/// The transforms; an object returned by `judge` replaces a transform. `judge` gets the transform,
/// its index, and whether its names and its stamp are readable.
template <class Judge>
nb::list decoded(const BytesLike& message, wire::Encoding encoding, const Judge& judge) {
    std::vector<TransformView> transforms;
    wire::decode_tf_message(message.bytes(), encoding, transforms);
    const nb::object type = record_type("TransformStamped");
    nb::list result;
    for (std::size_t i = 0; i < transforms.size(); ++i) {
        TransformView& view = transforms[i];
        const geometry::Vec3& t = view.pose.translation;
        const geometry::Quat& q = view.pose.rotation;
        const nb::object parent = text_of(view.parent);
        const nb::object child = text_of(view.child);
        const bool is_readable = view.stamp >= 0 && parent.is_valid() && child.is_valid();
        if (const nb::object other = judge(view, i, is_readable); other.is_valid()) {
            result.append(other);
            continue;
        }
        result.append(type(parent, child, view.stamp, nb::make_tuple(t.x, t.y, t.z),
                           nb::make_tuple(q.x, q.y, q.z, q.w)));
    }
    return result;
}

nb::list decode_members(nb::handle data, nb::handle encoding, bool is_static,
                        nb::handle authority) {
    const std::string_view sender = name_of(authority, "authority");
    const auto judge = [&](TransformView& view, std::size_t index, bool is_readable) -> nb::object {
        if (is_static)  // a store ignores the stamp of a static transform
            view.stamp = std::min(view.stamp, clock::kMaxStamp);
        if (is_readable && view.stamp <= clock::kMaxStamp)
            return {};
        return error_of(view, index, is_static, sender);
    };
    return decoded(BytesLike(data), encoding_of(encoding), judge);
}

PyObject* decode(PyObject* /*self*/, PyObject* const* args, Py_ssize_t count, PyObject* keywords) {
    return guarded([&]() -> PyObject* {
        constexpr ParameterList kList{"decode_tf_message", kDecodeNames, 1, 2};
        const auto [data, encoding] = bind<2>(kList, args, count, keywords);
        const auto judge = [](const TransformView& view, std::size_t index,
                              bool is_readable) -> nb::object {
            if (is_readable)
                return {};
            if (view.stamp < 0)
                throw_object(error_of(view, index, false, {}));
            const bool nul = has_nul(view.parent) || has_nul(view.child);
            const std::string reason = nul ? "has a control character" : "is not valid UTF-8";
            throw_error("InvalidName", "a frame name of the message " + reason,
                        {{"reason", nb::str(reason.c_str())},
                         {"edge", escaped(edge_of(view))},
                         {"index", nb::int_(index)}});
        };
        return decoded(BytesLike(data), encoding_or_cdr(encoding), judge).release().ptr();
    });
}

PyMethodDef g_encode = {
    "encode_tf_message", as_function(encode), METH_FASTCALL | METH_KEYWORDS,
    "encode_tf_message(transforms, encoding='cdr')\n--\n\n"
    "Bytes of one tf2_msgs/TFMessage, of what `set_transforms` takes; Columns without stamps get\n"
    "stamp 0. Raises InvalidStamp, InvalidName, InvalidArray, with `index`."};

PyMethodDef g_decode = {
    "decode_tf_message", as_function(decode), METH_FASTCALL | METH_KEYWORDS,
    "decode_tf_message(data, encoding='cdr')\n--\n\n"
    "Transforms of one tf2_msgs/TFMessage. Raises CorruptMessage; InvalidName, InvalidStamp, with\n"
    "`index`."};

constexpr const char* kIngestDoc =
    R"(Store one tf2_msgs/TFMessage from its bytes, as one commit.

Refused transforms are left out, as in tf2, and the others are stored.

Parameters
----------
data
    The message: bytes, bytearray, memoryview.
encoding
    `cdr` (ROS 2, with the encapsulation header), `ros1`, or one layout exactly: `cdr_le`,
    `cdr_be`, `cdr2_le`, `cdr2_be`, `cdr_bare_le`, `cdr_bare_be`.
static
    Whether it came from /tf_static.
authority
    Name of the sender.
change_kind, only_new
    As in `set_transforms`.

Returns
-------
int
    Number of the commit.

Raises
------
CorruptMessage
    The bytes are not a TFMessage. Fields: offset, reason.

And the errors of `set_transforms`, if no transform of the message can be stored. Nothing is stored
if it raises.

Warns
-----
TfdbWarning
    A transform was refused and others of its message were stored: once for each edge and error.

One leading '/' of a frame name is dropped, as tf does.)";

constexpr const char* kIngestManyDoc =
    R"(Store many TFMessages, one commit each.

Refused transforms are counted by edge and error, and the others of their message are stored.
Damaged messages are counted and left out. Arguments as in `ingest`. `authority` may be a sequence
with one name for each message; with another length it raises InvalidArgument, and nothing is
stored. Ctrl-C ends the call between two messages; those before are stored.)";

void bind_messages_of_recordings(nb::module_& module) {
    bind_recorded(module);
    bind_selection(module);
    bind_arrivals(module);
    bind_rewriting(module);
    module.def("ingest_recorded", &ingest_recorded, nb::arg("buffer"), nb::arg("messages").none(),
               nb::arg("first"), nb::arg("last"), nb::kw_only(), nb::arg("encoding").none(),
               nb::arg("static"), nb::arg("authorities"), nb::arg("selection").none() = nb::none(),
               nb::arg("rules") = nb::dict(), nb::arg("forgotten").none() = nb::none(),
               nb::sig("def ingest_recorded(buffer: Buffer, messages: Recorded, first: int, "
                       "last: int, *, encoding: str, static: bool, authorities: dict[int, str], "
                       "selection: Selection | None = None, rules: dict[int, int] = {}, "
                       "forgotten: Forgotten | None = None) -> tfdb.types.IngestResult"),
               "As `ingest_many`, of the messages at [first, last).\n\n"
               "`authorities` and the `rules` of `selection` are by source, rule 0 the default. "
               "`forgotten` counts what the buffer's history drops.");
    module.def("survey_recorded", &survey_recorded, nb::arg("survey"), nb::arg("messages").none(),
               nb::arg("first"), nb::arg("last"), nb::kw_only(), nb::arg("encoding").none(),
               nb::arg("static"), nb::arg("selection").none(), nb::arg("rules"),
               nb::sig("def survey_recorded(survey: EdgeSurvey, messages: Recorded, first: int, "
                       "last: int, *, encoding: str, static: bool, selection: Selection | None, "
                       "rules: dict[int, int]) -> None"),
               "Add the messages at [first, last) to `survey`. `selection` and `rules` as in "
               "`ingest_recorded`.");
    module.def("recorded_children", &recorded_children, nb::arg("messages").none(),
               nb::arg("first"), nb::arg("last"), nb::kw_only(), nb::arg("encoding").none(),
               nb::arg("static"), nb::arg("selection").none(), nb::arg("rules"),
               nb::sig("def recorded_children(messages: Recorded, first: int, last: int, *, "
                       "encoding: str, static: bool, selection: Selection | None, "
                       "rules: dict[int, int]) -> dict[int, dict[str, tuple[int, int]]]"),
               "The child frames of the messages at [first, last), by source, each with its first "
               "and last stamp in nanoseconds. `selection` and `rules` as in `ingest_recorded`.");
}

}  // namespace

void bind_wire(nb::module_& module, nb::class_<BufferObject, StoreReaderObject>& type) {
    type.def("ingest", &ingest, nb::arg("data").none(), nb::kw_only(),
             nb::arg("encoding").none() = "cdr", nb::arg("static") = false,
             nb::arg("authority").none() = "", nb::arg("change_kind") = false,
             nb::arg("only_new") = false,
             nb::sig("def ingest(self, data: tfdb.types.BytesLike, *, encoding: str = 'cdr', "
                     "static: bool = False, authority: str = '', change_kind: bool = False, "
                     "only_new: bool = False) -> int"),
             kIngestDoc);
    type.def("ingest_many", &ingest_many, nb::arg("messages").none(), nb::kw_only(),
             nb::arg("encoding").none(), nb::arg("static") = false,
             nb::arg("authority").none() = "",
             nb::sig("def ingest_many(self, messages: collections.abc.Iterable["
                     "tfdb.types.BytesLike], *, encoding: str, static: bool = False, authority: "
                     "str | collections.abc.Sequence[str] = '') -> tfdb.types.IngestResult"),
             kIngestManyDoc);
    bind_messages_of_recordings(module);
    module.def("ingest_members", &ingest_members, nb::arg("buffer"), nb::arg("data").none(),
               nb::kw_only(), nb::arg("encoding").none(), nb::arg("static"),
               nb::arg("authority").none(), nb::arg("change_kind"), nb::arg("only_new"),
               nb::sig("def ingest_members(buffer: Buffer, data: tfdb.types.BytesLike, *, "
                       "encoding: str, static: bool, authority: str, change_kind: bool, "
                       "only_new: bool) -> list[tfdb.types.Refused]"),
               "As `Buffer.ingest`; returns the refused members instead of a warning or an error.");
    module.def(
        "decode_members", &decode_members, nb::arg("data").none(), nb::arg("encoding").none(),
        nb::kw_only(), nb::arg("static"), nb::arg("authority").none(),
        nb::sig("def decode_members(data: tfdb.types.BytesLike, encoding: str, *, static: bool, "
                "authority: str) -> list[tfdb.TransformStamped | tfdb.TfdbError]"),
        "As `decode_tf_message`; the error of a member that cannot be read is in its place.");
    add_raw_function(module, g_encode);
    add_raw_function(module, g_decode);
}

}  // namespace tfdb::python
