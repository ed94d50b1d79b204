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

/// Messages in the order of storing.
/// Threads: the holder of the GIL. Guarantee: bytes do not move during its lifetime.
class Recorded {
public:
    Recorded() = default;
    Recorded(const Recorded&) = delete;
    Recorded& operator=(const Recorded&) = delete;

    /// Adds the wanted messages of an MCAP chunk (bytes, or a view of some), without a copy.
    /// `learn` gets schemas, channels and truncated messages, and may change the result of
    /// `wanted`. Returns None, or the offset at which the records are truncated and the length that
    /// the record beyond the chunk claims.
    nb::object add_mcap_chunk(nb::handle chunk, const nb::callable& wanted,
                              const nb::callable& learn);
    /// Adds a copy of one message.
    void add(std::uint64_t received, std::uint32_t source, const nb::bytes& data);
    void copy(std::uint64_t received, std::uint32_t source, std::span<const std::byte> data);
    /// Adds a message whose bytes belong to an object that is kept alive.
    void share(const RecordedMessage& message) { messages_.push_back(message); }
    void keep(nb::object owner) { kept_.push_back(std::move(owner)); }
    /// Adds the messages at [first, last) of another object, which is kept alive.
    void extend(nb::handle messages, std::size_t first, std::size_t last);
    /// Replaces source numbers, by the old ones.
    void renumber(const nb::dict& numbers);
    /// The index of the first message received at that time or later; the messages must be sorted.
    [[nodiscard]] std::size_t place(std::uint64_t received) const;
    /// Sorts them by receive time; equal times keep their order.
    void sort();

    [[nodiscard]] std::size_t size() const { return messages_.size(); }
    /// (received, source, bytes)
    [[nodiscard]] nb::tuple at(std::size_t index) const;
    /// The first and last receive time; requires at least one message.
    [[nodiscard]] nb::tuple span() const;
    /// The number of messages per source.
    [[nodiscard]] nb::dict counts() const;
    /// (first, last + 1) of consecutive messages whose sources have one kind, at most `most` each;
    /// `kinds` by source.
    [[nodiscard]] nb::list runs(const nb::dict& kinds, std::size_t most) const;
    [[nodiscard]] std::vector<RecordedMessage> between(std::size_t first, std::size_t last) const;

private:
    std::vector<RecordedMessage> messages_;
    std::vector<nb::object> kept_;  // the owners of the bytes
    std::vector<std::unique_ptr<std::byte[]>> copied_;
    std::span<std::byte> room_;  // of the last block filled by `add`
};

/// The encoding by its name. Throws InvalidArgument.
wire::Encoding encoding_of(nb::handle name);

void bind_recorded(nb::module_& module);

}  // namespace tfdb::python
