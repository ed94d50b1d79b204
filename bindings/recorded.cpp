#include "recorded.hpp"

#include <algorithm>
#include <cstring>
#include <map>
#include <tuple>

#include "arguments.hpp"
#include "errors.hpp"
#include "tfdb/wire/mcap_records.hpp"

namespace tfdb::python {
namespace {

using Records = wire::McapRecords;

// Larger than any block that allocators take from their heap: it returns to the system when it is
// released, whatever else was allocated. Its unused pages take no memory.
constexpr std::size_t kBlock = std::size_t{64} << 20;

std::span<const std::byte> bytes_of(const nb::bytes& object) {
    return {static_cast<const std::byte*>(object.data()), object.size()};
}

/// Immutable bytes: decoding relies on earlier checks.
struct Chunk {
    nb::object owner;
    std::span<const std::byte> bytes;

    explicit Chunk(nb::handle given) : owner(nb::borrow(given)) {
        if (PyMemoryView_Check(given.ptr())) {
            Py_buffer view;
            if (PyObject_GetBuffer(given.ptr(), &view, PyBUF_SIMPLE) == 0) {
                owner = given.attr("obj");
                bytes = {static_cast<const std::byte*>(view.buf),
                         static_cast<std::size_t>(view.len)};
                PyBuffer_Release(&view);
            } else {
                forget_error();
            }
        } else if (PyBytes_Check(given.ptr())) {
            bytes = bytes_of(nb::borrow<nb::bytes>(given));
        }
        if (!PyBytes_Check(owner.ptr())) {
            throw nb::type_error("a chunk must be bytes, or a memoryview of bytes");
        }
    }
};

nb::bytes copy_of(std::span<const std::byte> bytes) {
    return nb::bytes(bytes.data(), bytes.size());
}

/// Calls `wanted` once per channel, until `learn` is called.
class Wanted {
public:
    explicit Wanted(const nb::callable& ask) : ask_(ask) {}

    bool operator()(std::uint16_t channel) {
        const auto [known, is_new] = answers_.try_emplace(channel, false);
        if (is_new) {
            known->second = nb::cast<bool>(ask_(channel));
        }
        return known->second;
    }
    void forget() { answers_.clear(); }

private:
    const nb::callable& ask_;
    std::map<std::uint16_t, bool> answers_;
};

/// The wanted messages of a chunk, and their total size.
class Found {
public:
    void add(const Records& record) {
        const auto payload = record.payload();
        messages.push_back({record.log_time(), payload.data(),
                            static_cast<std::uint32_t>(payload.size()), record.channel()});
        bytes += payload.size();
    }
    /// Copies the bytes, so that the chunk can be freed.
    std::unique_ptr<std::byte[]> copy() {
        auto copied = std::make_unique_for_overwrite<std::byte[]>(bytes);
        std::byte* to = copied.get();
        for (RecordedMessage& message : messages) {
            std::memcpy(to, message.data, message.size);
            message.data = to;
            to += message.size;
        }
        return copied;
    }

    std::vector<RecordedMessage> messages;
    std::size_t bytes = 0;
};

}  // namespace

wire::Encoding encoding_of(nb::handle name) {
    const auto encoding = wire::encoding_from_name(option_of(name, "encoding"));
    if (!encoding) {
        throw_not_one_of(
            "encoding",
            {"ros1", "cdr", "cdr_le", "cdr_be", "cdr2_le", "cdr2_be", "cdr_bare_le", "cdr_bare_be"},
            name);
    }
    return *encoding;
}

nb::object Recorded::add_mcap_chunk(nb::handle given, const nb::callable& wanted,
                                    const nb::callable& learn) {
    const Chunk chunk(given);
    Wanted is_wanted(wanted);
    Found found;
    Records records(chunk.bytes);
    const auto keep = [&] {
        // A chunk with mostly other data is not worth its memory.
        if (found.bytes < chunk.bytes.size() / 2) {
            copied_.push_back(found.copy());
        } else {
            kept_.push_back(chunk.owner);
        }
        messages_.insert(messages_.end(), found.messages.begin(), found.messages.end());
    };
    try {
        for (std::size_t i = 0; records.next(); ++i) {
            look_for_signals(i);
            if (records.is_message()) {
                if (is_wanted(records.channel())) {
                    found.add(records);
                }
            } else if (records.kind() <= Records::kLastKnown) {
                learn(records.kind(), copy_of(records.content()));
                is_wanted.forget();
            }
        }
    } catch (...) {
        keep();
        throw;
    }
    keep();
    if (!records.is_broken()) {
        return nb::none();
    }
    return nb::make_tuple(records.at(), records.length());
}

void Recorded::add(std::uint64_t received, std::uint32_t source, const nb::bytes& data) {
    copy(received, source, bytes_of(data));
}

void Recorded::copy(std::uint64_t received, std::uint32_t source,
                    std::span<const std::byte> bytes) {
    if (bytes.size() > room_.size()) {
        const std::size_t size = std::max(bytes.size(), kBlock);
        copied_.push_back(std::make_unique_for_overwrite<std::byte[]>(size));
        room_ = {copied_.back().get(), size};
    }
    std::ranges::copy(bytes, room_.begin());
    messages_.push_back({received, room_.data(), static_cast<std::uint32_t>(bytes.size()), source});
    room_ = room_.subspan(bytes.size());
}

void Recorded::extend(nb::handle messages, std::size_t first, std::size_t last) {
    keep(nb::borrow(messages));
    const std::vector<RecordedMessage> more =
        nb::cast<const Recorded&>(messages).between(first, last);
    messages_.insert(messages_.end(), more.begin(), more.end());
}

void Recorded::renumber(const nb::dict& numbers) {
    std::map<std::uint32_t, std::uint32_t> given;
    for (const auto& [from, to] : numbers) {
        given[nb::cast<std::uint32_t>(from)] = nb::cast<std::uint32_t>(to);
    }
    for (RecordedMessage& message : messages_) {
        message.source = given.at(message.source);
    }
}

std::size_t Recorded::place(std::uint64_t received) const {
    const auto at = std::ranges::lower_bound(messages_, received, {}, &RecordedMessage::received);
    return static_cast<std::size_t>(at - messages_.begin());
}

void Recorded::sort() {
    const auto before = [](const RecordedMessage& a, const RecordedMessage& b) {
        return a.received < b.received;
    };
    if (!std::is_sorted(messages_.begin(), messages_.end(), before)) {
        std::stable_sort(messages_.begin(), messages_.end(), before);
    }
}

nb::tuple Recorded::at(std::size_t index) const {
    if (index >= messages_.size()) {
        throw nb::index_error();
    }
    const RecordedMessage& message = messages_[index];
    return nb::make_tuple(message.received, message.source, copy_of(message.bytes()));
}

nb::tuple Recorded::span() const {
    if (messages_.empty()) {
        throw nb::index_error();
    }
    const auto [first, last] =
        std::ranges::minmax_element(messages_, {}, &RecordedMessage::received);
    return nb::make_tuple(first->received, last->received);
}

nb::dict Recorded::counts() const {
    std::map<std::uint32_t, std::size_t> found;
    for (const RecordedMessage& message : messages_) {
        ++found[message.source];
    }
    nb::dict counts;
    for (const auto& [source, count] : found) {
        counts[nb::int_(source)] = count;
    }
    return counts;
}

nb::list Recorded::runs(const nb::dict& kinds, std::size_t most) const {
    std::map<std::uint32_t, std::int64_t> kind_of;
    for (const auto& [source, kind] : kinds) {
        kind_of[nb::cast<std::uint32_t>(source)] = nb::cast<std::int64_t>(kind);
    }
    nb::list runs;
    std::size_t first = 0;
    const auto end_at = [&](std::size_t last) {
        if (first < last) {
            runs.append(nb::make_tuple(first, last));
        }
        first = last;
    };
    for (std::size_t i = 0; i < messages_.size(); ++i) {
        const bool same = messages_[i].source == messages_[first].source ||
                          kind_of.at(messages_[i].source) == kind_of.at(messages_[first].source);
        if (!same || i - first == most) {
            end_at(i);
        }
    }
    end_at(messages_.size());
    return runs;
}

std::vector<RecordedMessage> Recorded::between(std::size_t first, std::size_t last) const {
    last = std::min(last, messages_.size());
    first = std::min(first, last);
    return {messages_.begin() + static_cast<std::ptrdiff_t>(first),
            messages_.begin() + static_cast<std::ptrdiff_t>(last)};
}

void bind_recorded(nb::module_& module) {
    nb::class_<Recorded>(module, "Recorded", "Messages of a recording, outside of Python.")
        .def(nb::init<>())
        .def("add_mcap_chunk", &Recorded::add_mcap_chunk, nb::arg("chunk"), nb::arg("wanted"),
             nb::arg("learn"),
             nb::sig("def add_mcap_chunk(self, chunk: bytes | memoryview, wanted: "
                     "collections.abc.Callable[[int], bool], learn: "
                     "collections.abc.Callable[[int, bytes], None]) -> tuple[int, int] | None"),
             "Add the wanted messages of an unpacked chunk, as they lie there.\n\n"
             "`learn` gets kind and content of the format's other records, and of messages that "
             "are too short.\nReturns where the records break off, and how long "
             "the one says that it is which goes beyond the chunk.")
        .def("add", &Recorded::add, nb::arg("received"), nb::arg("source"), nb::arg("data"),
             "Add one message.")
        .def("extend", &Recorded::extend, nb::arg("messages"), nb::arg("first"), nb::arg("last"),
             nb::sig("def extend(self, messages: Recorded, first: int, last: int) -> None"),
             "Add the messages at [first, last) of others.")
        .def("renumber", &Recorded::renumber, nb::arg("numbers"),
             nb::sig("def renumber(self, numbers: dict[int, int]) -> None"),
             "Replace the numbers of sources, by a dict from old to new.")
        .def("place", &Recorded::place, nb::arg("received"),
             "Index of the first message received at that time or later. The messages must be "
             "sorted.")
        .def("sort", &Recorded::sort,
             "Sort by the time of reception; messages of one time stay as they were added.")
        .def("__len__", &Recorded::size)
        .def("__getitem__", &Recorded::at, nb::arg("index"),
             nb::sig("def __getitem__(self, index: int) -> tuple[int, int, bytes]"))
        .def("span", &Recorded::span, nb::sig("def span(self) -> tuple[int, int]"),
             "Times of reception of the first and the last message; there must be one.")
        .def("counts", &Recorded::counts, nb::sig("def counts(self) -> dict[int, int]"),
             "Number of messages by source.")
        .def("runs", &Recorded::runs, nb::arg("kinds"), nb::arg("most"),
             nb::sig("def runs(self, kinds: dict[int, int], most: int) -> list[tuple[int, int]]"),
             "Ranges [first, last) of successive messages of one kind.");
}

}  // namespace tfdb::python
