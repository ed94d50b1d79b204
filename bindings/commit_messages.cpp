// Converts commits to the messages of a recording, and back.
#include "commit_messages.hpp"

#include <nanobind/stl/string.h>

#include <string>
#include <vector>

#include "arguments.hpp"
#include "bytes_like.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "tfdb/wire/commit_messages.hpp"
#include "tfdb/wire/crc32c.hpp"

namespace tfdb::python {
namespace {

nb::object bytes_or_none(const std::vector<std::byte>& bytes) {
    if (bytes.empty())
        return nb::none();
    return nb::bytes(bytes.data(), bytes.size());
}

/// Calls `choose` with the GIL, which the caller does not hold.
wire::ChooseName choice_of(nb::handle choose) {
    if (choose.is_none())
        return {};
    return [choose](std::string_view name) -> wire::ChosenName {
        const nb::gil_scoped_acquire gil;
        const auto chosen = nb::cast<nb::tuple>(choose(str_of_name(name)));
        return {nb::cast<std::string>(chosen[0]), nb::cast<bool>(chosen[1])};
    };
}

nb::list messages_of_commits(nb::handle data, nb::handle since, nb::handle choose) {
    const BytesLike bytes(data, "data");
    const CommitNumber from = count_of(since, "since", 0, kMaxCommit);
    std::vector<wire::CommitMessages> made;
    {
        const nb::gil_scoped_release release;
        made = wire::messages_of_commits(bytes.bytes(), from, choice_of(choose));
    }
    nb::list messages;
    for (const wire::CommitMessages& each : made)
        messages.append(nb::make_tuple(each.commit, bytes_or_none(each.moving),
                                       bytes_or_none(each.fixed), bytes_or_none(each.whole)));
    return messages;
}

nb::bytes commit_of_messages(nb::handle epoch, nb::handle since, nb::handle commit,
                             nb::handle moving, nb::handle fixed) {
    const BytesLike of(epoch, "epoch");
    if (of.bytes().size() != 24)
        throw InvalidArgument("epoch must be the 24 bytes of a sample's head, got " +
                              std::to_string(of.bytes().size()));
    const auto word = [&](std::size_t at, bool is_big) {
        std::uint64_t number = 0;
        for (std::size_t i = 0; i < 8; ++i) {
            const auto byte = std::to_integer<std::uint64_t>(of.bytes()[at + i]);
            number |= byte << 8 * (is_big ? 7 - i : i);
        }
        return number;
    };
    const nb::bytes none("", 0);
    const BytesLike first(moving.is_none() ? nb::handle(none) : moving, "moving");
    const BytesLike second(fixed.is_none() ? nb::handle(none) : fixed, "static");
    const std::vector<std::byte> made = wire::commit_of_messages(
        {word(0, false), word(8, true), word(16, true)}, count_of(since, "since", 0, kMaxCommit),
        count_of(commit, "commit", 1, kMaxCommit), first.bytes(), second.bytes());
    return nb::bytes(made.data(), made.size());
}

std::uint32_t checksum_of(nb::handle data) {
    return wire::crc32c(BytesLike(data, "data").bytes());
}

}  // namespace

void bind_commit_messages(nb::module_& module) {
    module.def(
        "messages_of_commits", &messages_of_commits, nb::arg("data").none(), nb::arg("since"),
        nb::arg("choose").none(),
        nb::sig("def messages_of_commits(data: bytes, since: int, choose: "
                "collections.abc.Callable[[str], tuple[str, bool]] | None) -> "
                "list[tuple[int, bytes | None, bytes | None, bytes | None]]"),
        "The messages of commits, or of a state.\n\n"
        "Returns a tuple for each commit: its number, the TFMessages of its moving and its "
        "static edges, and the bytes for `apply` if the messages do not contain everything. A "
        "state always has these bytes. They follow the commit before, the first ones `since`. "
        "`choose` returns a frame's new name, and whether the edge to its parent is kept.");
    module.def("commit_of_messages", &commit_of_messages, nb::arg("epoch").none(), nb::arg("since"),
               nb::arg("commit"), nb::arg("moving").none(), nb::arg("static").none(),
               nb::sig("def commit_of_messages(epoch: bytes, since: int, commit: int, "
                       "moving: bytes | None, static: bytes | None) -> bytes"),
               "The bytes for `apply` of a commit that stores the transforms of TFMessages.\n\n"
               "`epoch` is the 24 bytes that the source's samples have at 8.");
    module.def("crc32c", &checksum_of, nb::arg("data").none(),
               nb::sig("def crc32c(data: bytes | memoryview) -> int"),
               "The CRC-32C of bytes, with which samples end.");
}

}  // namespace tfdb::python
