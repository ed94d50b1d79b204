// Commits and states as bytes: export and import.
#include <nanobind/stl/string.h>

#include <cstring>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "bytes_like.hpp"
#include "commits.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "records.hpp"
#include "writes.hpp"

namespace tfdb::python {
namespace {

nb::bytes bytes_of(const std::vector<std::byte>& bytes) {
    return nb::bytes(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

/// (number, id): the id as 16 bytes.
nb::object epoch_record(const Epoch& epoch) {
    char id[16];
    for (std::size_t i = 0; i < 8; ++i) {
        id[i] = static_cast<char>(epoch.high >> (8 * (7 - i)));
        id[8 + i] = static_cast<char>(epoch.low >> (8 * (7 - i)));
    }
    return record_type("Epoch")(epoch.number, nb::bytes(id, sizeof id));
}

Epoch epoch_of(nb::handle record) {
    const nb::object number = nb::getattr(record, "number", nb::none());
    const nb::object id = nb::getattr(record, "id", nb::none());
    const BytesLike bytes(id, "id");
    if (bytes.bytes().size() != 16)
        throw InvalidArgument("the id of an epoch has 16 bytes");
    const auto half = [&](std::size_t first) {
        std::uint64_t value = 0;
        for (const std::byte byte : bytes.bytes().subspan(first, 8))
            value = value << 8 | std::to_integer<std::uint64_t>(byte);
        return value;
    };
    return {count_of(number, "number", 0, std::uint64_t{1} << 63), half(0), half(8)};
}

nb::bytes commits_bytes(BufferObject& self, nb::handle since, nb::handle max_commits,
                        nb::handle max_bytes, nb::handle frames) {
    const CommitNumber from = count_of(since, "since", 0, kMaxCommit);
    SampleLimits limits;
    limits.commits = count_of(max_commits, "max_commits", 1, kMaxCommit);
    limits.bytes = count_of(max_bytes, "max_bytes", 1, kMaxCommit);
    const ChosenFrames chosen(frames);
    std::vector<std::byte> bytes;
    {
        const LongWork work(true);
        bytes = self.open_store().commits_bytes(from, limits, chosen.only());
    }
    return bytes_of(bytes);
}

nb::bytes state_bytes(nb::handle self, nb::handle frames, nb::handle newest) {
    const Pinned pinned = pin(self, object_of<SnapshotObject>(self));
    const ChosenFrames chosen(frames);
    const std::size_t most =
        newest.is_none() ? ~std::size_t{0} : count_of(newest, "newest", 1, kMaxCommit);
    std::vector<std::byte> bytes;
    {
        const LongWork work(true);
        bytes = pinned.keep->state_bytes(chosen.only(), most);
    }
    return bytes_of(bytes);
}

/// For a player: while it runs, no other thread applies samples to the buffer.
nb::bytes state_bytes_as(BufferObject& self, nb::handle source) {
    const std::string_view name = name_of(source, "source");
    std::vector<std::byte> bytes;
    {
        const LongWork work(true);
        const Snapshot state = self.open_store().snapshot();
        for (const Position& position : self.store.positions()) {
            if (position.source == name)
                bytes = state.state_bytes(std::nullopt, ~std::size_t{0}, &position);
        }
    }
    return bytes_of(bytes);
}

bool forget_source(BufferObject& self, nb::handle source) {
    const std::string_view name = name_of(source, "source");
    const LongWork work(true);
    return self.open_store().forget_source(name);
}

/// For tfdb.net. `from`: the required position; None: any.
nb::object hand_over(BufferObject& self, nb::handle source, nb::handle how, nb::handle epoch,
                     nb::handle commit, nb::handle from) {
    const std::string_view kind = name_of(how, "how");
    if (kind != "follow" && kind != "release" && kind != "adopt")
        throw InvalidArgument("how is 'follow', 'release' or 'adopt'");
    const Handover handover = kind == "follow"    ? Handover::kFollow
                              : kind == "release" ? Handover::kRelease
                                                  : Handover::kAdopt;
    const auto position_at = [&](nb::handle at_epoch, nb::handle at_commit) {
        Position position;
        position.source = name_of(source, "source");
        position.epoch = epoch_of(at_epoch);
        position.commit = count_of(at_commit, "commit", 0, kMaxCommit);
        return position;
    };
    const Position to = position_at(epoch, commit);
    std::optional<Position> expected;
    if (!from.is_none()) {
        const nb::object at_epoch = nb::getattr(from, "epoch", nb::none());
        const nb::object at_commit = nb::getattr(from, "commit", nb::none());
        expected = position_at(at_epoch, at_commit);
    }
    std::optional<HandedOver> done;
    {
        const LongWork work(true);
        done = self.open_store().hand_over(handover, to, expected);
    }
    return done ? nb::object(nb::make_tuple(done->commit, done->is_whole, done->last)) : nb::none();
}

nb::list positions(BufferObject& self) {
    nb::list records;
    for (const Position& position : self.open_store().positions())
        records.append(position_record(position));
    return records;
}

constexpr const char* kCommitsBytesDoc =
    R"(Return the commits after `since` as bytes, for `apply` of another buffer.

Each commit is whole, with everything that it stored, cleared and removed, poses to the last bit.
`docs/wire.md` describes the bytes.

Parameters
----------
since
    A commit: that of a snapshot, or of the position that `apply` returned. 0: from the beginning.
max_commits
    Largest number of commits.
max_bytes
    Largest size. A commit is never cut: a larger one is returned alone.
frames
    A frame, or several: only these and their edges. A frame may be created later: the commit that
    creates it is returned. None: all.

Returns
-------
bytes
    Empty if nothing was committed since.

Raises
------
FeedLapped
    The feed does not reach back that far: take `state_bytes` of a snapshot.
Gone
    A sample of these commits is no longer kept. Hold a snapshot of your position to prevent it.
InvalidArgument
    The commit does not exist yet, or a limit is not positive.
InvalidName
    A name in `frames` is invalid.
NotSupported
    The engine has no feed; only `snapshot` and `giant` have one.
TransactionActive
    This thread has a transaction open in the store.)";

constexpr const char* kStateBytesDoc =
    R"(Return this state as bytes, for `apply` of another buffer.

Parameters
----------
frames
    A frame, or several: only these and their edges. A missing frame is left out; later commits
    (`commits_bytes` with the same frames) create it. None: all.
newest
    Largest number of samples of each edge, the newest ones. None: all.

Raises SnapshotTooOld, SnapshotClosed; InvalidName for a name that no frame can have.)";

}  // namespace

nb::object position_record(const Position& position) {
    return record_type("Position")(str_of_name(position.source), epoch_record(position.epoch),
                                   position.commit, str_of_name(position.prefix));
}

void bind_commits(nb::class_<BufferObject, StoreReaderObject>& type) {
    type.def("commits_bytes", &commits_bytes, nb::arg("since").none(), nb::kw_only(),
             nb::arg("max_commits").none() = 64, nb::arg("max_bytes").none() = 1 << 20,
             nb::arg("frames").none() = nb::none(),
             nb::sig("def commits_bytes(self, since: int, *, max_commits: int = 64, "
                     "max_bytes: int = 1048576, "
                     "frames: str | collections.abc.Iterable[str] | None = None) -> bytes"),
             kCommitsBytesDoc);
    type.def("forget_source", &forget_source, nb::arg("source").none(),
             nb::sig("def forget_source(self, source: str) -> bool"),
             R"(Forget how far the commits of a source have been applied.

Use it if a source has ended, or if `apply` raises Fenced because the clock of the source was set
back. Its frames stay, and every writer may write them. The next bytes of this source must be a
state, of any epoch, which replaces its frames. The source's name and prefix stay in use.

Returns False, and changes nothing, if nothing of the source was applied. Raises as a write:
ReadOnly, LockTimeout, NotSupported, TransactionActive.)");
    type.def("positions", &positions, nb::sig("def positions(self) -> list[tfdb.types.Position]"),
             R"(Return how far the commits of each source have been applied.

In the order in which the sources came first. A frozen store has none.)");
    type.def(
        "_state_bytes_as", &state_bytes_as, nb::arg("source"),
        nb::sig("def _state_bytes_as(self, source: str) -> bytes"),
        "Return the newest state as bytes that the later commits of this source follow; b\"\" if "
        "nothing of it was applied.");
    type.def("_hand_over", &hand_over, nb::arg("source"), nb::arg("how"), nb::arg("epoch"),
             nb::arg("commit") = 0, nb::arg("from_").none() = nb::none(),
             nb::sig("def _hand_over(self, source: str, how: "
                     "typing.Literal['follow', 'release', 'adopt'], epoch: tfdb.types.Epoch, "
                     "commit: int = 0, from_: tfdb.types.Position | None = None) "
                     "-> tuple[int, bool, int] | None"),
             R"(Set the position of a source, in one commit, since its home is another one.

`follow`: the new home goes on exactly at the position. `release`: this store is the home now, and its
writers may write. `adopt`: it was the home, and what they stored is the source's from now on.
`from_`: where the position must be; then `adopt` is for a store that was made the home there, and
`follow` for one that was not. Returns the commit, whether the store was equal to the source before,
and the source's commit then. Returns None, and changes nothing, if the position is elsewhere, or
`adopt` names an earlier epoch than the position.)");
    type.def_prop_ro(
        "epoch", [](BufferObject& self) { return epoch_record(self.open_store().epoch()); },
        nb::sig("def epoch(self) -> tfdb.types.Epoch"),
        "The store's epoch: a new store has a later one. Its commits are numbered in it.");
}

void bind_state_bytes(nb::class_<SnapshotObject, StoreReaderObject>& type) {
    type.def("state_bytes", &state_bytes, nb::kw_only(), nb::arg("frames").none() = nb::none(),
             nb::arg("newest").none() = nb::none(),
             nb::sig("def state_bytes(self, *, "
                     "frames: str | collections.abc.Iterable[str] | None = None, "
                     "newest: int | None = None) -> bytes"),
             kStateBytesDoc);
}

}  // namespace tfdb::python
