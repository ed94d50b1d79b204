// Messages of a recording, kept outside of Python until they are stored.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "tfdb/wire/tf_message.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// A message: receive time, source, and bytes that another object owns.
struct RecordedMessage {
    std::uint64_t received;
    const std::byte* data;
    std::uint32_t size;
    std::uint32_t source;

    [[nodiscard]] std::span<const std::byte> bytes() const { return {data, size}; }
};

/// Messages in the order in which they are to be stored.
/// Threads: the holder of the GIL. Guarantee: bytes stay where they are while this lives.
class Recorded {
public:
    Recorded() = default;
    Recorded(const Recorded&) = delete;
    Recorded& operator=(const Recorded&) = delete;

    /// Adds the wanted messages of an MCAP chunk (bytes, or a view of some), as they lie there;
    /// schemas, channels and what is too short for a message are handed to `learn`, which may
    /// change what is `wanted`. Returns None, or where the records break off and how long the one
    /// says that it is which goes beyond the chunk.
    nb::object add_mcap_chunk(nb::handle chunk, const nb::callable& wanted,
                              const nb::callable& learn);
    /// Adds a copy of one message.
    void add(std::uint64_t received, std::uint32_t source, const nb::bytes& data);
    void copy(std::uint64_t received, std::uint32_t source, std::span<const std::byte> data);
    /// Adds a message whose bytes an object owns that is kept.
    void share(const RecordedMessage& message) { messages_.push_back(message); }
    void keep(nb::object owner) { kept_.push_back(std::move(owner)); }
    /// Adds those at [first, last) of others, which are kept.
    void extend(nb::handle messages, std::size_t first, std::size_t last);
    /// Gives sources other numbers, by the ones that they have.
    void renumber(const nb::dict& numbers);
    /// Where the first message is that was received at a time or later; they are sorted.
    [[nodiscard]] std::size_t place(std::uint64_t received) const;
    /// Puts them in the order of reception; those of one time stay as they were added.
    void sort();

    [[nodiscard]] std::size_t size() const { return messages_.size(); }
    /// (received, source, bytes)
    [[nodiscard]] nb::tuple at(std::size_t index) const;
    /// The times of the first and the last that was received; there is one at least.
    [[nodiscard]] nb::tuple span() const;
    /// How many there are of each source.
    [[nodiscard]] nb::dict counts() const;
    /// (first, last + 1) of messages that follow each other and whose sources are of one kind, at
    /// most `most` in each; `kinds` by source.
    [[nodiscard]] nb::list runs(const nb::dict& kinds, std::size_t most) const;
    [[nodiscard]] std::vector<RecordedMessage> between(std::size_t first, std::size_t last) const;

private:
    std::vector<RecordedMessage> messages_;
    std::vector<nb::object> kept_;  // the owners of the bytes
    std::vector<std::unique_ptr<std::byte[]>> copied_;
    std::span<std::byte> room_;  // of the last block that `add` fills
};

/// The layout of messages by its name. Throws InvalidArgument.
wire::Encoding encoding_of(nb::handle name);

void bind_recorded(nb::module_& module);

}  // namespace tfdb::python
