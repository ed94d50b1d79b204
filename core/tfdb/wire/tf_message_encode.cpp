#include <string>

#include "tfdb/wire/layout.hpp"
#include "tfdb/wire/tf_message.hpp"

namespace tfdb::wire {

namespace {

constexpr std::size_t kMaxMessageBytes = std::numeric_limits<std::uint32_t>::max();

ErrorDetail detail_of(const TransformView& transform, std::size_t index) {
    ErrorDetail detail;
    detail.parent = transform.parent;
    detail.edge = transform.child;
    detail.index = index;
    return detail;
}

[[noreturn]] void refuse_stamp(const TransformView& transform, std::size_t index,
                               std::uint32_t max_seconds) {
    ErrorDetail detail = detail_of(transform, index);
    detail.stamp = transform.stamp;
    throw InvalidStamp("transforms[" + std::to_string(index) + "]: stamp " +
                           std::to_string(transform.stamp) + " ns does not fit the message: 0 to " +
                           std::to_string(max_seconds) + " seconds",
                       detail);
}

[[noreturn]] void refuse_name(const TransformView& transform, std::size_t index) {
    throw InvalidName("transforms[" + std::to_string(index) + "]: NUL in a frame name",
                      detail_of(transform, index));
}

[[noreturn]] void refuse_size(std::size_t index) {
    ErrorDetail detail;
    detail.index = index;
    throw InvalidArgument("transforms[" + std::to_string(index) + "]: a message cannot hold 4 GiB",
                          detail);
}

// Readers drop one '/', so a name that starts with '/' gets another one.
bool needs_slash(std::string_view name, bool had_slash) noexcept {
    return had_slash || name.starts_with('/');
}

template <Layout kLayout>
std::size_t after_name(std::size_t position, std::string_view name, bool had_slash) noexcept {
    position += padding<kLayout>(position, 4) + 4;
    return position + (needs_slash(name, had_slash) ? 1 : 0) + name.size() + kLayout.closing_nul;
}

/// Size of the message after the encapsulation header. It rejects all values that cannot be
/// written, so that writing needs no checks.
template <Layout kLayout>
std::size_t checked_size(std::span<const TransformView> transforms) {
    std::size_t size = kLayout.delimited ? 8 : 4;
    for (std::size_t i = 0; i < transforms.size(); ++i) {
        const TransformView& transform = transforms[i];
        size += padding<kLayout>(size, 4) + kLayout.prefix_bytes + 8;
        size = after_name<kLayout>(size, transform.parent, transform.slash_before_parent);
        size = after_name<kLayout>(size, transform.child, transform.slash_before_child);
        size += padding<kLayout>(size, 8) + kPoseBytes;
        if (size > kMaxMessageBytes) {
            refuse_size(i);
        }
        if (transform.stamp < 0 ||
            transform.stamp / clock::kNanosPerSecond > clock::StampNs{kLayout.max_seconds}) {
            refuse_stamp(transform, i, kLayout.max_seconds);
        }
        if (transform.parent.find('\0') != std::string_view::npos ||
            transform.child.find('\0') != std::string_view::npos) {
            refuse_name(transform, i);
        }
    }
    return size;
}

// One message being written into zeroed bytes of the size from checked_size().
// Threads: one. Guarantee: skips padding, cannot fail.
template <Layout kLayout>
class Writer {
public:
    Writer(std::byte* origin, std::size_t size) : origin_(origin), size_(size) {}

    void write_message(std::span<const TransformView> transforms) noexcept {
        if constexpr (kLayout.delimited) {
            write_u32(size_ - 4);
        }
        write_u32(transforms.size());
        for (const TransformView& transform : transforms) {
            write_transform(transform);
        }
    }

private:
    void write_transform(const TransformView& transform) noexcept {
        position_ += kLayout.prefix_bytes;
        write_u32(static_cast<std::uint64_t>(transform.stamp / clock::kNanosPerSecond));
        write_u32(static_cast<std::uint64_t>(transform.stamp % clock::kNanosPerSecond));
        write_name(transform.parent, transform.slash_before_parent);
        write_name(transform.child, transform.slash_before_child);
        position_ += padding<kLayout>(position_, 8);
        store_pose<kLayout>(origin_ + position_, transform.pose);
        position_ += kPoseBytes;
    }

    void write_name(std::string_view name, bool had_slash) noexcept {
        const bool slash = needs_slash(name, had_slash);
        write_u32((slash ? 1 : 0) + name.size() + kLayout.closing_nul);
        if (slash) {
            origin_[position_++] = std::byte{'/'};
        }
        if (!name.empty()) {  // the data of an empty view may be null
            std::memcpy(origin_ + position_, name.data(), name.size());
        }
        position_ += name.size() + kLayout.closing_nul;
    }

    void write_u32(std::uint64_t word) noexcept {
        position_ += padding<kLayout>(position_, 4);
        store_u32<kLayout>(origin_ + position_, static_cast<std::uint32_t>(word));
        position_ += 4;
    }

    std::byte* origin_;
    std::size_t size_;
    std::size_t position_ = 0;
};

template <Layout kLayout>
void write_bare(std::span<const TransformView> transforms, std::vector<std::byte>& out) {
    const std::size_t size = checked_size<kLayout>(transforms);
    out.assign(size, std::byte{0});
    Writer<kLayout>(out.data(), size).write_message(transforms);
}

template <Layout kLayout>
void write_headed(std::span<const TransformView> transforms, std::vector<std::byte>& out) {
    const std::size_t size = checked_size<kLayout>(transforms);
    out.assign(kHeaderBytes + size, std::byte{0});
    out[1] = std::byte{kLayout.header_id};
    Writer<kLayout>(out.data() + kHeaderBytes, size).write_message(transforms);
}

}  // namespace

void encode_tf_message(std::span<const TransformView> transforms, Encoding encoding,
                       std::vector<std::byte>& out) {
    switch (encoding) {
        case Encoding::kRos1:
            return write_bare<kRos1Layout>(transforms, out);
        case Encoding::kCdr:
        case Encoding::kCdrLittle:
            return write_headed<kCdrLittleLayout>(transforms, out);
        case Encoding::kCdrBig:
            return write_headed<kCdrBigLayout>(transforms, out);
        case Encoding::kCdr2Little:
            return write_headed<kCdr2LittleLayout>(transforms, out);
        case Encoding::kCdr2Big:
            return write_headed<kCdr2BigLayout>(transforms, out);
        case Encoding::kCdrBareLittle:
            return write_bare<kCdrLittleLayout>(transforms, out);
        case Encoding::kCdrBareBig:
            return write_bare<kCdrBigLayout>(transforms, out);
    }
    throw InvalidArgument("not an encoding of a TFMessage: " +
                          std::to_string(static_cast<int>(encoding)));
}

}  // namespace tfdb::wire
