#include "tfdb/wire/commit_sample.hpp"

#include <algorithm>
#include <bit>
#include <string>

#include "tfdb/wire/crc32c.hpp"

namespace tfdb::wire {

namespace {

using Kind = CommitSample::Kind;
using Row = CommitSample::Row;
using Edge = CommitSample::Edge;
using Bytes = std::vector<std::byte>;

constexpr std::array kMagic{std::byte{'T'}, std::byte{'F'}, std::byte{'D'}, std::byte{'B'}};
constexpr std::uint8_t kVersion = 0;
constexpr std::size_t kHeadBytes = 36;
constexpr std::size_t kSumBytes = 4;
constexpr std::size_t kMostVarint = 10;

/// Flags before a commit's four lists: the lists that are present.
constexpr unsigned kAllLists = 0xF;
// Flags in an edge's first number. In a commit the name's index follows above them.
constexpr unsigned kStatic = 1;
constexpr unsigned kOtherAuthority = 2;  // differs from the previous edge's
constexpr unsigned kManyRows = 4;        // more or fewer than one row: their number follows
constexpr unsigned kEdgeBits = 3;
// Further flags of a frame in a state.
constexpr unsigned kWasCleared = 8;
constexpr unsigned kLate = 16;  // the number of late samples follows
constexpr unsigned kFrameBits = 5;
/// Maximum of an edge's late samples.
constexpr std::uint64_t kMostLate = (std::uint64_t{1} << 48) - 1;
/// A flag in a row's first byte; the other bits mark the numbers that differ.
constexpr std::uint8_t kOtherParent = 0x80;

constexpr std::uint64_t zigzag(std::int64_t number) {
    return static_cast<std::uint64_t>(number) << 1 ^ static_cast<std::uint64_t>(number >> 63);
}
constexpr std::int64_t from_zigzag(std::uint64_t word) {
    return static_cast<std::int64_t>(word >> 1 ^ (~(word & 1) + 1));
}
constexpr std::uint64_t difference(clock::StampNs a, clock::StampNs b) {
    return static_cast<std::uint64_t>(a) - static_cast<std::uint64_t>(b);
}

std::byte* store_varint(std::byte* to, std::uint64_t number) {
    for (; number >= 0x80; number >>= 7)
        *to++ = std::byte(0x80 | (number & 0x7F));
    *to++ = std::byte(number);
    return to;
}

/// Space for that many bytes at the end of a vector, of which some are used.
/// Threads: one. Guarantee: as the vector's.
class Room {
public:
    Room(Bytes& bytes, std::size_t most) : bytes_(bytes), size_(bytes.size()) {
        if (bytes.capacity() < size_ + most)
            bytes.reserve(2 * (size_ + most));
        bytes.resize(size_ + most);
        at = bytes.data() + size_;
    }
    ~Room() { bytes_.resize(static_cast<std::size_t>(at - bytes_.data())); }
    Room(const Room&) = delete;
    Room& operator=(const Room&) = delete;

    void put(std::uint64_t number) { at = store_varint(at, number); }
    void put(std::span<const std::byte> data) { at = std::copy(data.begin(), data.end(), at); }

    std::byte* at;

private:
    Bytes& bytes_;
    std::size_t size_;
};

void add_text(Bytes& to, std::string_view text) {
    Room room(to, kMostVarint + text.size());
    room.put(text.size());
    room.put(std::as_bytes(std::span(text)));
}

void store_u64(std::byte* to, std::uint64_t number) {
    store_u32<kCdrLittleLayout>(to, static_cast<std::uint32_t>(number));
    store_u32<kCdrLittleLayout>(to + 4, static_cast<std::uint32_t>(number >> 32));
}
std::uint64_t load_u64(const std::byte* from) {
    return load_u32<kCdrLittleLayout>(from) | std::uint64_t{load_u32<kCdrLittleLayout>(from + 4)}
                                                  << 32;
}

}  // namespace

std::uint32_t digest_of(std::span<const std::string_view> names) {
    std::vector<std::string_view> sorted(names.begin(), names.end());
    std::sort(sorted.begin(), sorted.end());
    sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
    std::string text;
    for (const std::string_view name : sorted)
        text.append(name).push_back('\0');
    return std::max(crc32c(std::as_bytes(std::span(text))), std::uint32_t{1});
}

// -- writing ------------------------------------------------------------------------------------

void SampleWriter::start() {
    body_.clear();
    names_.clear();
    authorities_.clear();
    name_count_ = authority_count_ = authority_ = 0;
    commits_ = 0;
    before_.clear();
    stamp_ = 0;
}

std::uint32_t SampleWriter::add_name(std::string_view name) {
    add_text(names_, name);
    before_.emplace_back();
    return name_count_++;
}

std::uint32_t SampleWriter::add_authority(std::string_view name) {
    add_text(authorities_, name);
    return ++authority_count_;
}

void SampleWriter::start_commit(std::uint64_t after, const Lists& lists, std::size_t edges) {
    ++commits_;
    const std::span<const std::uint32_t> all[] = {lists.cleared, lists.removed, lists.passing,
                                                  lists.made};
    std::uint8_t bits = 0;
    std::size_t refs = 0;
    for (std::size_t i = 0; i < std::size(all); ++i) {
        bits |= static_cast<std::uint8_t>(all[i].empty() ? 0U : 1U << i);
        refs += all[i].size();
    }
    Room room(body_, kMostVarint * (6 + refs) + 1);
    room.put(after);
    *room.at++ = std::byte{bits};
    for (const auto& list : all) {
        if (!list.empty())
            room.put(list.size());
        for (const std::uint32_t name : list)
            room.put(name);
    }
    room.put(edges);
}

void SampleWriter::add_edge(const Edge& edge, std::span<const Row> rows) {
    {
        Room room(body_, 3 * kMostVarint);
        const unsigned bits = (edge.is_static ? kStatic : 0U) |
                              (edge.authority != authority_ ? kOtherAuthority : 0U) |
                              (rows.size() != 1 ? kManyRows : 0U);
        room.put(std::uint64_t{edge.child} << kEdgeBits | bits);
        if (edge.authority != authority_)
            room.put(edge.authority);
        if (rows.size() != 1)
            room.put(rows.size());
    }
    write_rows(edge, rows);
}

void SampleWriter::add_frame(const Edge& edge, std::span<const Row> rows) {
    {
        Room room(body_, 1 + 3 * kMostVarint);
        const unsigned bits = (edge.is_static ? kStatic : 0U) |
                              (edge.authority != authority_ ? kOtherAuthority : 0U) |
                              (rows.size() != 1 ? kManyRows : 0U) |
                              (edge.cleared ? kWasCleared : 0U) | (edge.late != 0 ? kLate : 0U);
        *room.at++ = std::byte(bits);
        if (edge.authority != authority_)
            room.put(edge.authority);
        if (rows.size() != 1)
            room.put(rows.size());
        if (edge.late != 0)
            room.put(edge.late);
    }
    write_rows(edge, rows);
}

void SampleWriter::write_rows(const Edge& edge, std::span<const Row> rows) {
    authority_ = edge.authority;
    Before& before = before_[edge.child];
    Room room(body_, rows.size() * (1 + 2 * kMostVarint + kPoseBytes));
    for (const Row& row : rows) {
        std::byte& first = *room.at++;
        unsigned bits = 0;
        const std::uint32_t parent = row.parent << 1 | (row.gone ? 1U : 0U);
        if (!before.any || before.parent != parent) {
            bits = kOtherParent;
            room.put(parent);
        }
        if (!edge.is_static) {
            room.put(zigzag(static_cast<std::int64_t>(difference(row.stamp, stamp_))));
            stamp_ = row.stamp;
        }
        for (std::size_t i = 0; i < row.numbers.size(); ++i) {
            if (row.numbers[i] == before.numbers[i])
                continue;
            bits |= 1U << i;
            store_u64(room.at, row.numbers[i]);
            room.at += 8;
        }
        first = std::byte(bits);
        before = {true, parent, row.numbers};
    }
}

SampleWriter::Mark SampleWriter::mark() const {
    return {body_.size(), names_.size(),    authorities_.size(),
            name_count_,  authority_count_, commits_};
}

void SampleWriter::cut(const Mark& mark) {
    body_.resize(mark.body);
    names_.resize(mark.names);
    authorities_.resize(mark.authorities);
    name_count_ = mark.name_count;
    authority_count_ = mark.authority_count;
    commits_ = mark.commits;
}

std::size_t SampleWriter::size() const {
    constexpr std::size_t kCounts = 5 * 5;
    return kHeadBytes + kSumBytes + kCounts + body_.size() + names_.size() + authorities_.size();
}

Bytes SampleWriter::finish(Kind kind, const Epoch& epoch, std::uint32_t choice, CommitNumber since,
                           CommitNumber last, std::uint64_t frames) const {
    Bytes sample;
    {
        Room room(sample, kHeadBytes + kSumBytes + 6 * kMostVarint + body_.size() + names_.size() +
                              authorities_.size());
        room.put(kMagic);
        *room.at++ = std::byte{kVersion};
        *room.at++ = std::byte(kind);
        *room.at++ = std::byte{0};
        *room.at++ = std::byte{0};
        // The id's bytes, most significant first.
        for (const std::uint64_t word :
             {epoch.number, __builtin_bswap64(epoch.high), __builtin_bswap64(epoch.low)}) {
            store_u64(room.at, word);
            room.at += 8;
        }
        store_u32<kCdrLittleLayout>(room.at, choice);
        room.at += 4;
        room.put(since);
        if (kind == Kind::kCommits)
            room.put(last - since);
        room.put(name_count_);
        room.put(names_);
        room.put(authority_count_);
        room.put(authorities_);
        room.put(kind == Kind::kCommits ? commits_ : frames);
        room.put(body_);
    }
    const std::uint32_t sum = crc32c(sample);
    sample.resize(sample.size() + kSumBytes);
    store_u32<kCdrLittleLayout>(sample.data() + sample.size() - kSumBytes, sum);
    return sample;
}

// -- reading ------------------------------------------------------------------------------------

namespace {

/// A sample being read.
/// Threads: one. Guarantee: reads no byte outside the data; rejects with CorruptMessage.
class Decoder {
public:
    Decoder(std::span<const std::byte> data, CommitSample& out)
        : data_(data), end_(data.size()), out_(out) {}

    void run() {
        out_.clear();
        read_head();
        out_.since = read_number("the commit", kMaxCommit);
        const bool is_state = out_.kind == Kind::kState;
        out_.last = out_.since;
        if (!is_state)
            out_.last += read_number("the number of commits", kMaxCommit - out_.since);
        read_texts(out_.names, "the number of names", "the size of a name");
        out_.authorities.emplace_back();
        read_texts(out_.authorities, "the number of authorities", "the size of an authority");
        before_.assign(out_.names.size(), {});
        if (is_state)
            read_state();
        else
            read_commits();
        if (at_ != end_)
            refuse(at_, std::to_string(end_ - at_) + " bytes follow the sample");
    }

private:
    struct Before {
        bool any = false;
        std::uint32_t parent = 0;
        std::array<std::uint64_t, 7> numbers{};
    };

    [[noreturn, gnu::noinline, gnu::cold]] static void refuse(std::size_t at,
                                                              const std::string& why) {
        throw CorruptMessage(at, why);
    }

    [[noreturn, gnu::noinline, gnu::cold]] static void refuse_number(std::size_t at,
                                                                     const char* what,
                                                                     std::uint64_t number,
                                                                     std::uint64_t most) {
        refuse(at, std::string(what) + " is " + std::to_string(number) + ", at most " +
                       std::to_string(most) + " is possible");
    }

    void read_head() {
        if (end_ < kHeadBytes + kSumBytes)
            refuse(end_, "commits and states have at least " +
                             std::to_string(kHeadBytes + kSumBytes) + " bytes, these are " +
                             std::to_string(end_));
        if (!std::equal(kMagic.begin(), kMagic.end(), data_.begin()))
            refuse(0, "commits and states begin with the letters TFDB");
        if (const auto version = byte_at(4); version != kVersion)
            refuse(4, "version " + std::to_string(version) + ": this program reads version " +
                          std::to_string(kVersion));
        const unsigned kind = byte_at(5);
        if (kind != static_cast<unsigned>(Kind::kCommits) &&
            kind != static_cast<unsigned>(Kind::kState))
            refuse(5, "kind " + std::to_string(kind) + ": commits are 1, a state 2");
        if (byte_at(6) != 0 || byte_at(7) != 0)
            refuse(6, "unknown flags");
        end_ -= kSumBytes;
        const std::uint32_t sum = load_u32<kCdrLittleLayout>(data_.data() + end_);
        if (sum != crc32c(data_.first(end_)))
            refuse(end_, "the checksum is wrong: the sample was damaged or cut short");
        out_.kind = static_cast<Kind>(kind);
        out_.epoch = {load_u64(data_.data() + 8), __builtin_bswap64(load_u64(data_.data() + 16)),
                      __builtin_bswap64(load_u64(data_.data() + 24))};
        if (out_.epoch == Epoch{})
            refuse(8, "the epoch is 0");
        out_.choice = load_u32<kCdrLittleLayout>(data_.data() + 32);
        at_ = kHeadBytes;
    }

    [[nodiscard]] unsigned byte_at(std::size_t at) const {
        return std::to_integer<unsigned>(data_[at]);
    }
    std::uint8_t read_byte(const char* what) {
        if (at_ == end_) [[unlikely]]
            refuse(at_, std::string("the sample ends where ") + what + " is expected");
        return static_cast<std::uint8_t>(byte_at(at_++));
    }
    std::uint64_t read_varint(const char* what) {
        const std::size_t start = at_;
        std::uint64_t number = read_byte(what);
        if (number < 0x80) [[likely]]
            return number;
        number &= 0x7F;
        for (unsigned shift = 7;; shift += 7) {
            const std::uint64_t byte = read_byte(what);
            if (shift == 63 && byte > 1)
                refuse(start, std::string(what) + " has more than 64 bits");
            number |= (byte & 0x7F) << shift;
            if (byte >= 0x80)
                continue;
            if (byte == 0)
                refuse(at_ - 1, std::string(what) + " has a byte too many");
            return number;
        }
    }
    std::uint64_t read_number(const char* what, std::uint64_t most) {
        const std::size_t start = at_;
        const std::uint64_t number = read_varint(what);
        if (number > most) [[unlikely]]
            refuse_number(start, what, number, most);
        return number;
    }
    /// Bounded by the remaining bytes, so that a hostile count makes no vector grow.
    std::uint32_t read_count(const char* what, std::size_t least_bytes) {
        return static_cast<std::uint32_t>(
            read_number(what, std::min<std::size_t>((end_ - at_) / least_bytes, 0xFFFF'FFFF)));
    }
    std::uint32_t read_name(const char* what) {
        const std::size_t start = at_;
        const std::uint64_t name = read_varint(what);
        if (name >= out_.names.size()) [[unlikely]]
            refuse(start, std::string(what) + " is name " + std::to_string(name) +
                              ", the sample has " + std::to_string(out_.names.size()));
        return static_cast<std::uint32_t>(name);
    }

    void read_texts(std::vector<std::string_view>& texts, const char* number, const char* size) {
        const std::uint32_t count = read_count(number, 1);
        for (std::uint32_t i = 0; i < count; ++i) {
            const std::size_t start = at_;
            const std::uint64_t bytes = read_varint(size);
            if (bytes > end_ - at_)
                refuse_number(start, size, bytes, end_ - at_);
            texts.emplace_back(reinterpret_cast<const char*>(data_.data() + at_), bytes);
            at_ += bytes;
        }
    }

    [[nodiscard]] std::size_t place_of(std::string_view text) const {
        return static_cast<std::size_t>(reinterpret_cast<const std::byte*>(text.data()) -
                                        data_.data());
    }
    /// The frames of a state are ordered by their names' bytes; other names follow.
    void check_state_names(std::uint32_t frames) {
        const std::vector<std::string_view>& names = out_.names;
        for (std::uint32_t name = 1; name < frames; ++name) {
            if (names[name] <= names[name - 1])
                refuse(place_of(names[name]), "the frames of a state are not in order");
        }
        if (frames == names.size())
            return;
        std::vector<std::string_view> sorted = names;
        std::stable_sort(sorted.begin(), sorted.end());
        const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
        if (twice != sorted.end())
            refuse(place_of(twice[1]), "a name stands twice");
    }

    void read_commits() {
        const std::uint32_t count = read_count("the number of commits", 3);
        CommitNumber before = out_.since;
        for (std::uint32_t i = 0; i < count; ++i) {
            CommitSample::Commit commit;
            const std::size_t start = at_;
            const std::uint64_t after = read_number("a commit", out_.last - before);
            if (after == 0)
                refuse(start, "a commit has the number of the one before");
            commit.number = before += after;
            const std::size_t at = at_;
            const unsigned bits = read_byte("a commit");
            if (bits > kAllLists)
                refuse(at, "unknown lists of a commit");
            CommitSample::Range* const lists[] = {&commit.cleared, &commit.removed, &commit.passing,
                                                  &commit.made};
            for (std::size_t k = 0; k < std::size(lists); ++k) {
                if ((bits & 1U << k) != 0)
                    *lists[k] = read_list();
            }
            commit.edges = {static_cast<std::uint32_t>(out_.edges.size()),
                            read_count("the number of edges", 2)};
            for (std::uint32_t k = 0; k < commit.edges.count; ++k)
                read_edge();
            out_.commits.push_back(commit);
        }
    }
    CommitSample::Range read_list() {
        const std::size_t start = at_;
        const CommitSample::Range range{static_cast<std::uint32_t>(out_.refs.size()),
                                        read_count("the number of names", 1)};
        if (range.count == 0)
            refuse(start, "a list has no names");
        for (std::uint32_t i = 0; i < range.count; ++i)
            out_.refs.push_back(read_name("a frame"));
        return range;
    }
    void read_edge() {
        const std::size_t start = at_;
        const std::uint64_t head = read_varint("an edge");
        Edge edge;
        if (head >> kEdgeBits >= out_.names.size())
            refuse(start, "an edge is name " + std::to_string(head >> kEdgeBits) +
                              ", the sample has " + std::to_string(out_.names.size()));
        edge.child = static_cast<std::uint32_t>(head >> kEdgeBits);
        const std::uint32_t rows = read_edge_head(edge, static_cast<unsigned>(head));
        read_rows(edge, rows);
    }
    std::uint32_t read_edge_head(Edge& edge, unsigned bits) {
        edge.is_static = (bits & kStatic) != 0;
        if ((bits & kOtherAuthority) != 0) {
            const std::size_t start = at_;
            const auto other = static_cast<std::uint32_t>(
                read_number("an authority", out_.authorities.size() - 1));
            if (other == authority_)
                refuse(start, "an authority is that of the edge before, as without it");
            authority_ = other;
        }
        edge.authority = authority_;
        if ((bits & kManyRows) == 0)
            return 1;
        const std::size_t start = at_;
        const std::uint32_t rows = read_count("the number of samples", 2);
        if (rows == 1)
            refuse(start, "the number of samples is 1, as without it");
        return rows;
    }

    void read_state() {
        const std::size_t count_at = at_;
        const std::uint32_t count = read_count("the number of frames", 1);
        if (count > out_.names.size())
            refuse(count_at, std::to_string(count) + " frames have " +
                                 std::to_string(out_.names.size()) + " names");
        check_state_names(count);
        CommitSample::Commit state;
        state.number = out_.last;
        state.made.count = static_cast<std::uint32_t>(out_.names.size());
        for (std::uint32_t name = 0; name < out_.names.size(); ++name)
            out_.refs.push_back(name);
        state.edges.count = count;
        for (std::uint32_t name = 0; name < count; ++name) {
            const std::size_t start = at_;
            const unsigned bits = read_byte("a frame");
            if (bits >> kFrameBits != 0)
                refuse(start, "unknown properties of a frame");
            Edge edge;
            edge.child = name;
            edge.cleared = (bits & kWasCleared) != 0;
            const std::uint32_t rows = read_edge_head(edge, bits);
            if (edge.cleared && rows != 0)
                refuse(start, "a cleared edge has samples");
            if ((bits & kLate) != 0)
                edge.late = read_late();
            read_rows(edge, rows);
        }
        out_.commits.push_back(state);
    }

    std::uint64_t read_late() {
        const std::size_t start = at_;
        const std::uint64_t late = read_number("the number of late samples", kMostLate);
        if (late == 0)
            refuse(start, "the number of late samples is 0, as without it");
        return late;
    }

    void read_rows(Edge& edge, std::uint32_t count) {
        if (edge.is_static && count != 1)
            refuse(at_, "a static edge has one sample, not " + std::to_string(count));
        edge.rows = {static_cast<std::uint32_t>(out_.rows.size()), count};
        out_.rows.resize(out_.rows.size() + count);
        Before& before = before_[edge.child];
        Row* row = out_.rows.data() + edge.rows.first;
        for (std::uint32_t i = 0; i < count; ++i, ++row) {
            const std::size_t start = at_;
            read_row(edge, before, *row);
            if (i > 0 && row->stamp <= row[-1].stamp)
                refuse(start, "the samples of an edge do not ascend");
        }
        out_.edges.push_back(edge);
    }
    void read_row(const Edge& edge, Before& before, Row& row) {
        const std::size_t start = at_;
        const unsigned bits = read_byte("a sample");
        if ((bits & kOtherParent) != 0)
            read_parent(before);
        else if (!before.any)
            refuse(start, "the first sample of an edge has no parent");
        row.parent = before.parent >> 1;
        row.gone = (before.parent & 1) != 0;
        row.stamp = 0;
        if (!edge.is_static) {
            const std::int64_t step = from_zigzag(read_varint("a stamp"));
            stamp_ = static_cast<clock::StampNs>(static_cast<std::uint64_t>(stamp_) +
                                                 static_cast<std::uint64_t>(step));
            row.stamp = stamp_;
        }
        const auto numbers = static_cast<std::size_t>(std::popcount(bits & 0x7FU));
        if (end_ - at_ < 8 * numbers)
            refuse(at_, "the sample ends amid a pose");
        for (std::size_t i = 0; i < row.numbers.size(); ++i) {
            if ((bits & 1U << i) == 0)
                continue;
            const std::uint64_t number = load_u64(data_.data() + at_);
            if (number == before.numbers[i])
                refuse(at_, "a number is that of the sample before, as without it");
            before.numbers[i] = number;
            at_ += 8;
        }
        row.numbers = before.numbers;
    }
    void read_parent(Before& before) {
        const std::size_t start = at_;
        const std::uint64_t parent = read_varint("a parent");
        const bool is_removed = out_.kind == Kind::kState && (parent & 1) != 0;
        if (is_removed && parent != 1)
            refuse(start, "a removed parent is " + std::to_string(parent) + ", in a state 1");
        if (!is_removed && parent >> 1 >= out_.names.size())
            refuse(start, "a parent is name " + std::to_string(parent >> 1) + ", the sample has " +
                              std::to_string(out_.names.size()));
        if (before.any && parent == before.parent)
            refuse(start, "a parent is that of the sample before, as without it");
        before.any = true;
        before.parent = static_cast<std::uint32_t>(parent);
    }

    std::span<const std::byte> data_;
    std::size_t at_ = 0;
    std::size_t end_;
    CommitSample& out_;
    std::vector<Before> before_;
    clock::StampNs stamp_ = 0;
    std::uint32_t authority_ = 0;
};

}  // namespace

void CommitSample::clear() {
    names.clear();
    authorities.clear();
    refs.clear();
    commits.clear();
    edges.clear();
    rows.clear();
}

void CommitSample::decode(std::span<const std::byte> data) {
    Decoder(data, *this).run();
}

}  // namespace tfdb::wire
