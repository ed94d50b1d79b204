// Rewriting of recorded messages into another recording.
#include "rewriting.hpp"

#include <nanobind/stl/string.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "recorded.hpp"
#include "records.hpp"
#include "tfdb/store/message_rewriter.hpp"
#include "tfdb/wire/message_chunk.hpp"

namespace tfdb::python {
namespace {

using wire::MessageChunk;

/// Origins by source. The publishers' names are valid as long as the dict.
std::map<std::uint32_t, MessageRewriter::Origin> origins_of(const nb::dict& given,
                                                            wire::Encoding encoding,
                                                            bool is_static) {
    std::map<std::uint32_t, MessageRewriter::Origin> origins;
    for (const auto& [source, parts] : given) {
        const nb::object authority = parts[0];
        origins[nb::cast<std::uint32_t>(source)] = {encoding, is_static,
                                                    name_of(authority, "authority"),
                                                    nb::cast<std::uint32_t>(parts[1])};
    }
    return origins;
}

void rewrite(MessageRewriter& self, Recorded& out, nb::handle messages, std::size_t first,
             std::size_t last, nb::handle encoding, bool is_static, const nb::dict& sources,
             nb::handle selection) {
    constexpr std::size_t kTogether = 1024;
    const auto& from = nb::cast<const Recorded&>(messages);
    const auto origins = origins_of(sources, encoding_of(encoding), is_static);
    wire::Selection* const chosen =
        selection.is_none() ? nullptr : &nb::cast<wire::Selection&>(selection);
    out.keep(nb::borrow(messages));
    for (; first < last; first += kTogether) {
        look_for_signals(0);
        const std::vector<RecordedMessage> together =
            from.between(first, std::min(last, first + kTogether));
        const LongWork work(true);
        for (const RecordedMessage& message : together) {
            const auto made = self.rewrite(message.bytes(), origins.at(message.source), chosen);
            if (made.data() == message.data)
                out.share(message);
            else if (made.data() != nullptr)
                out.copy(message.received, message.source, made);
        }
    }
}

nb::list refusals(const MessageRewriter& self) {
    const nb::object type = record_type("RefusedEdge");
    nb::list found;
    for (const MessageRewriter::Refusal& each : self.refusals())
        found.append(type(escaped(each.edge), class_name(each.code), each.count,
                          escaped(each.first), each.is_message));
    return found;
}

MessageChunk::Format format_of(nb::handle name) {
    const std::string given = option_of(name, "format");
    if (given == "mcap")
        return MessageChunk::Format::kMcap;
    if (given == "bag")
        return MessageChunk::Format::kBag;
    throw_not_one_of("format", {"mcap", "bag"}, name);
}

/// Adds messages until the chunk is larger than `size`. Returns the index of the next message.
std::size_t fill(MessageChunk& self, const Recorded& messages, std::size_t first,
                 std::size_t size) {
    for (const RecordedMessage& message : messages.between(first, messages.size())) {
        if (self.bytes().size() > size)
            break;
        self.add_message(message.source, message.received, message.bytes());
        ++first;
    }
    return first;
}

nb::list indexes(const MessageChunk& self) {
    nb::list found;
    for (const auto& [channel, index] : self.indexes())
        found.append(nb::make_tuple(channel, index.messages,
                                    nb::bytes(index.entries.data(), index.entries.size())));
    return found;
}

void bind_chunk(nb::module_& module) {
    nb::class_<MessageChunk>(module, "MessageChunk",
                             "A chunk of an MCAP file or a bag that is written.")
        .def(
            "__init__",
            [](MessageChunk* self, nb::handle format) {
                new (self) MessageChunk(format_of(format));
            },
            nb::arg("format"), nb::sig("def __init__(self, format: str) -> None"),
            "`format`: 'mcap' or 'bag'.")
        .def(
            "add_record",
            [](MessageChunk& self, const nb::bytes& record) {
                self.add_record({static_cast<const std::byte*>(record.data()), record.size()});
            },
            nb::arg("record"), "Add a record as it is.")
        .def(
            "fill", &fill, nb::arg("messages"), nb::arg("first"), nb::arg("size"),
            "Add messages from `first` on until the chunk is larger than `size` bytes; a source is "
            "a channel or connection.\n\nReturns the position of the next message.")
        .def("clear", &MessageChunk::clear, "Remove all records.")
        .def("__len__", [](const MessageChunk& self) { return self.bytes().size(); })
        .def(
            "records",
            [](const MessageChunk& self) {
                return nb::bytes(self.bytes().data(), self.bytes().size());
            },
            "The bytes of all records.")
        .def("indexes", &indexes, nb::sig("def indexes(self) -> list[tuple[int, int, bytes]]"),
             "Channel or connection, number of messages, and their index entries.")
        .def_prop_ro("start", &MessageChunk::start, "Time of the first message, nanoseconds.")
        .def_prop_ro("end", &MessageChunk::end, "Time of the last message, nanoseconds.");
}

}  // namespace

void bind_rewriting(nb::module_& module) {
    const auto count = [](std::uint64_t MessageRewriter::Counts::*field) {
        return [field](const MessageRewriter& self) { return self.counts().*field; };
    };
    using Counts = MessageRewriter::Counts;
    nb::class_<MessageRewriter>(module, "MessageRewriter",
                                "Rewrites recorded TFMessages: selects, renames and encodes them.")
        .def(
            "__init__",
            [](MessageRewriter* self, nb::handle encoding) {
                new (self) MessageRewriter(encoding_of(encoding));
            },
            nb::arg("encoding"), nb::sig("def __init__(self, encoding: str) -> None"),
            "`encoding`: that of the messages to be written.")
        .def("rewrite", &rewrite, nb::arg("out"), nb::arg("messages"), nb::arg("first"),
             nb::arg("last"), nb::kw_only(), nb::arg("encoding"), nb::arg("static"),
             nb::arg("sources"), nb::arg("selection").none(),
             nb::sig("def rewrite(self, out: Recorded, messages: Recorded, first: int, last: int, "
                     "*, encoding: str, static: bool, sources: dict[int, tuple[str, int]], "
                     "selection: Selection | None) -> None"),
             "Add the selected parts of the messages at [first, last) to `out`.\n\n"
             "`sources` are by source: publisher, rule of `selection`, and whether empty names are "
             "refused.")
        .def_prop_ro("messages", count(&Counts::messages), "Messages written.")
        .def_prop_ro("transforms", count(&Counts::transforms), "Transforms in these.")
        .def_prop_ro("refused", count(&Counts::refused),
                     "Refused transforms in messages with accepted ones.")
        .def_prop_ro("broken", count(&Counts::broken), "Messages of which nothing can be written.")
        .def_prop_ro("left_out", count(&Counts::left_out), "Messages without a selected transform.")
        .def("refusals", &refusals, nb::sig("def refusals(self) -> list[tfdb.types.RefusedEdge]"),
             "Refused transforms, by edge and error.");
    bind_chunk(module);
}

}  // namespace tfdb::python
