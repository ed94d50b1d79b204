#include <cstdio>
#include <string>

#include "tfdb/wire/layout.hpp"
#include "tfdb/wire/tf_message.hpp"

namespace tfdb::wire {

namespace {

constexpr const char* kFrameId = "header.frame_id";
constexpr const char* kChildFrameId = "child_frame_id";

// One message being read.
// Threads: one. Guarantee: reads no byte outside `data`; rejects with CorruptMessage.
template <Layout kLayout>
class Reader {
public:
    /// `origin` is the base of alignment: the first byte after the encapsulation header.
    Reader(std::span<const std::byte> data, std::size_t origin)
        : bytes_(data.data()), origin_(origin), position_(origin), end_(data.size()) {}

    void read_message(std::vector<TransformView>& out) {
        const std::size_t size = end_;
        if constexpr (kLayout.delimited) {
            read_delimiter();
        }
        out.resize(read_count());
        for (index_ = 0; index_ < out.size(); ++index_) {
            read_transform(out[index_]);
        }
        if (kLayout.delimited && position_ != end_) {
            refuse(position_, "the sequence ends before its delimiter header says");
        }
        if (size - position_ > kLayout.max_trailing) {
            refuse(position_, std::to_string(size - position_) + " bytes follow the message");
        }
    }

private:
    static constexpr std::size_t kStampBytes = 8;
    static constexpr std::size_t kLengthBytes = 4;

    void read_delimiter() {
        need(kLengthBytes, "delimiter header");
        const std::size_t size = load_u32<kLayout>(bytes_ + position_);
        position_ += kLengthBytes;
        if (size > end_ - position_) {
            refuse(position_ - kLengthBytes, "the delimiter header says " + std::to_string(size) +
                                                 " bytes, " + std::to_string(end_ - position_) +
                                                 " are left");
        }
        end_ = position_ + size;
    }

    // Bounded by the remaining bytes, so a hostile count cannot make `out` grow.
    std::size_t read_count() {
        need(kLengthBytes, "count of transforms");
        const std::size_t count = load_u32<kLayout>(bytes_ + position_);
        position_ += kLengthBytes;
        if (count > (end_ - position_) / kLayout.min_transform) {
            refuse(position_ - kLengthBytes, std::to_string(count) +
                                                 " transforms cannot fit into " +
                                                 std::to_string(end_ - position_) + " bytes");
        }
        return count;
    }

    void read_transform(TransformView& transform) {
        align(4);
        need_of_transform(kLayout.prefix_bytes + kStampBytes + kLengthBytes, "header");
        position_ += kLayout.prefix_bytes;
        transform.stamp = read_stamp();
        transform.parent = read_name(kFrameId, transform.slash_before_parent);
        align(4);
        need_of_transform(kLengthBytes, kChildFrameId);
        transform.child = read_name(kChildFrameId, transform.slash_before_child);
        align(8);
        need_of_transform(kPoseBytes, "transform");
        load_pose<kLayout>(bytes_ + position_, transform.pose);
        position_ += kPoseBytes;
    }

    clock::StampNs read_stamp() noexcept {
        const std::uint32_t word = load_u32<kLayout>(bytes_ + position_);
        const std::uint32_t nanos = load_u32<kLayout>(bytes_ + position_ + 4);
        position_ += kStampBytes;
        if (nanos >= clock::kNanosPerSecond) [[unlikely]] {
            return clock::with_excess(nanos);
        }
        clock::StampNs seconds = word;
        if constexpr (kLayout.max_seconds == kMaxSignedSeconds) {
            seconds = static_cast<std::int32_t>(word);
        }
        return seconds * clock::kNanosPerSecond + clock::StampNs{nanos};
    }

    // The caller has checked the four bytes of the length.
    std::string_view read_name(const char* field, bool& slash) {
        const std::size_t length = load_u32<kLayout>(bytes_ + position_);
        position_ += kLengthBytes;
        if (length > end_ - position_) {
            refuse_length(field, length);
        }
        const char* const text = reinterpret_cast<const char*>(bytes_ + position_);
        if (kLayout.closing_nul != 0 && (length == 0 || text[length - 1] != '\0')) {
            refuse_field(position_, field, "no closing NUL");
        }
        std::string_view name(text, length - kLayout.closing_nul);
        position_ += length;
        slash = name.starts_with('/');
        name.remove_prefix(slash ? 1 : 0);
        return name;
    }

    // May move the position past the end: the following read checks it.
    void align(std::size_t size) noexcept {
        position_ += padding<kLayout>(position_ - origin_, size);
    }

    void need(std::size_t size, const char* field) {
        if (position_ + size > end_) [[unlikely]] {
            refuse(position_ < end_ ? position_ : end_, std::string("truncated in the ") + field);
        }
    }

    void need_of_transform(std::size_t size, const char* field) {
        if (position_ + size > end_) [[unlikely]] {
            refuse_field(position_ < end_ ? position_ : end_, field, "truncated");
        }
    }

    [[noreturn, gnu::cold, gnu::noinline]] void refuse(std::size_t offset,
                                                       const std::string& reason) const {
        throw CorruptMessage(offset, reason);
    }

    [[noreturn, gnu::cold, gnu::noinline]] void refuse_field(std::size_t offset, const char* field,
                                                             const std::string& reason) const {
        throw CorruptMessage(offset,
                             "transforms[" + std::to_string(index_) + "]." + field + ": " + reason);
    }

    [[noreturn, gnu::cold, gnu::noinline]] void refuse_length(const char* field,
                                                              std::size_t length) const {
        refuse_field(position_ - kLengthBytes, field,
                     "length " + std::to_string(length) + ", " + std::to_string(end_ - position_) +
                         " bytes are left");
    }

    const std::byte* bytes_;
    std::size_t origin_;
    std::size_t position_;
    std::size_t end_;
    std::size_t index_ = 0;
};

/// Returns the second byte of the encapsulation header, and checks that it means a plain layout.
std::uint8_t read_header(std::span<const std::byte> data) {
    if (data.size() < kHeaderBytes) {
        throw CorruptMessage(data.size(), "truncated in the encapsulation header");
    }
    const auto first = std::to_integer<unsigned>(data[0]);
    const auto second = std::to_integer<unsigned>(data[1]);
    const bool plain = second == kCdrBigLayout.header_id || second == kCdrLittleLayout.header_id ||
                       second == kCdr2BigLayout.header_id || second == kCdr2LittleLayout.header_id;
    if (first != 0 || !plain) {
        char text[96];
        std::snprintf(text, sizeof text,
                      "representation %02x %02x is neither plain CDR (00 00, 00 01) nor plain CDR2 "
                      "(00 06, 00 07)",
                      first, second);
        throw CorruptMessage(0, text);
    }
    return static_cast<std::uint8_t>(second);
}

template <Layout kLayout>
void read_bare(std::span<const std::byte> data, std::vector<TransformView>& out) {
    Reader<kLayout>(data, 0).read_message(out);
}

template <Layout kLayout>
void read_headed(std::span<const std::byte> data, std::vector<TransformView>& out) {
    if (read_header(data) != kLayout.header_id) {
        throw CorruptMessage(0, "the encapsulation header names another encoding");
    }
    Reader<kLayout>(data, kHeaderBytes).read_message(out);
}

void read_as_header_says(std::span<const std::byte> data, std::vector<TransformView>& out) {
    switch (read_header(data)) {
        case kCdrLittleLayout.header_id:
            return Reader<kCdrLittleLayout>(data, kHeaderBytes).read_message(out);
        case kCdrBigLayout.header_id:
            return Reader<kCdrBigLayout>(data, kHeaderBytes).read_message(out);
        case kCdr2LittleLayout.header_id:
            return Reader<kCdr2LittleLayout>(data, kHeaderBytes).read_message(out);
        default:
            return Reader<kCdr2BigLayout>(data, kHeaderBytes).read_message(out);
    }
}

void read_encoding(std::span<const std::byte> data, Encoding encoding,
                   std::vector<TransformView>& out) {
    switch (encoding) {
        case Encoding::kRos1:
            return read_bare<kRos1Layout>(data, out);
        case Encoding::kCdr:
            return read_as_header_says(data, out);
        case Encoding::kCdrLittle:
            return read_headed<kCdrLittleLayout>(data, out);
        case Encoding::kCdrBig:
            return read_headed<kCdrBigLayout>(data, out);
        case Encoding::kCdr2Little:
            return read_headed<kCdr2LittleLayout>(data, out);
        case Encoding::kCdr2Big:
            return read_headed<kCdr2BigLayout>(data, out);
        case Encoding::kCdrBareLittle:
            return read_bare<kCdrLittleLayout>(data, out);
        case Encoding::kCdrBareBig:
            return read_bare<kCdrBigLayout>(data, out);
    }
    throw InvalidArgument("not an encoding of a TFMessage: " +
                          std::to_string(static_cast<int>(encoding)));
}

}  // namespace

std::optional<Encoding> encoding_from_name(std::string_view name) noexcept {
    struct Entry {
        std::string_view name;
        Encoding encoding;
    };
    static constexpr Entry kEntries[] = {
        {"ros1", Encoding::kRos1},
        {"cdr", Encoding::kCdr},
        {"cdr_le", Encoding::kCdrLittle},
        {"cdr_be", Encoding::kCdrBig},
        {"cdr2_le", Encoding::kCdr2Little},
        {"cdr2_be", Encoding::kCdr2Big},
        {"cdr_bare_le", Encoding::kCdrBareLittle},
        {"cdr_bare_be", Encoding::kCdrBareBig},
    };
    for (const Entry& entry : kEntries) {
        if (entry.name == name) {
            return entry.encoding;
        }
    }
    return std::nullopt;
}

bool is_little_endian(std::span<const std::byte> data, Encoding encoding) noexcept {
    if (encoding == Encoding::kCdr)
        return data.size() > 1 && (data[1] & std::byte{1}) != std::byte{0};
    return encoding != Encoding::kCdrBig && encoding != Encoding::kCdr2Big &&
           encoding != Encoding::kCdrBareBig;
}

void decode_tf_message(std::span<const std::byte> data, Encoding encoding,
                       std::vector<TransformView>& out) {
    try {
        read_encoding(data, encoding, out);
    } catch (...) {
        out.clear();
        throw;
    }
}

}  // namespace tfdb::wire
