// Decodes and encodes tf2_msgs/TFMessage (and ROS 1's tf/tfMessage, with the same layout) without
// intermediate objects: no allocation per message, and frame names as views into the bytes.
//
// A message is a count and that many of: header (stamp, frame_id), child_frame_id, 3 + 4 doubles.
//
//   ROS 1   nothing is aligned; strings are a length and bytes; the header starts with `seq`, which
//           is ignored and written as 0; secs and nsecs are unsigned.
//   CDR     each field is aligned to its size, counted from the first byte after the 4-byte
//           encapsulation header; a string's length counts its closing NUL; sec is signed.
//   CDR2    (plain XCDR2) the same, but doubles are aligned to 4, and the sequence is preceded by
//           its size in bytes: XTypes 1.3 demands this "DHEADER" for every sequence of structs.
//
// A message with a broken structure is rejected with CorruptMessage, never repaired. The offset
// names the byte; the reason names the field and the transform. Known harmless differences between
// writers:
//   - padding may hold anything (Fast CDR leaves it uninitialised); it is written as zeros;
//   - up to three bytes may follow a CDR message (RTPS rounds payloads up to a multiple of four);
//   - the two option bytes of the encapsulation header are ignored, as RTPS tells receivers to.
// An invalid stamp, name or pose is passed on, so that the store refuses one transform and accepts
// the others:
// - names: one leading '/' is dropped, as in tf; all other bytes stay, including an embedded NUL;
//   - numbers: the seven doubles stay bit for bit, NaN included;
//   - stamps: negative seconds make a negative stamp, nanoseconds of a second or more
//     `clock::with_excess`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <type_traits>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/clock/stamp.hpp"
#include "tfdb/geometry/pose.hpp"

namespace tfdb::wire {

// One transform of a message: it maps points of `child` into `parent`.
// Threads: a value. The names are views that are valid as long as their bytes.
// Guarantee: trivially copyable.
struct TransformView {
    std::string_view parent;
    std::string_view child;
    clock::StampNs stamp = 0;
    geometry::Pose pose{};
    // Re-encoding a message keeps the '/' before the name, which readers drop.
    bool slash_before_parent = false;
    bool slash_before_child = false;
};
static_assert(std::is_trivially_copyable_v<TransformView>);

/// The encoding of a message. kCdr is for a payload with an encapsulation header, which determines
/// the layout; every other value means exactly one layout. The layout of a bare payload is never
/// guessed: `00 01 00 00` starts a little-endian message with a header, and also a bare message of
/// 256 transforms.
enum class Encoding : std::uint8_t {
    kRos1,           // ROS 1 serialisation
    kCdr,            // reads any of the next four, according to the header; writes kCdrLittle
    kCdrLittle,      // header 00 01: what ROS 2 sends and records
    kCdrBig,         // header 00 00
    kCdr2Little,     // header 00 07
    kCdr2Big,        // header 00 06
    kCdrBareLittle,  // CDR without the encapsulation header
    kCdrBareBig,
};

/// Encoding by its name in Python and on the command line: "ros1", "cdr", "cdr_le", "cdr_be",
/// "cdr2_le", "cdr2_be", "cdr_bare_le", "cdr_bare_be". Empty for any other name.
[[nodiscard]] std::optional<Encoding> encoding_from_name(std::string_view name) noexcept;

/// Whether the numbers of a message for `decode_tf_message` are little-endian.
[[nodiscard]] bool is_little_endian(std::span<const std::byte> data, Encoding encoding) noexcept;

/// Replaces `out` by the transforms of one message. The views point into `data`; `out` keeps its
/// capacity, so decoding repeatedly into one vector allocates nothing.
/// Threads: reentrant. Throws CorruptMessage; `out` is then empty.
void decode_tf_message(std::span<const std::byte> data, Encoding encoding,
                       std::vector<TransformView>& out);

/// Replaces `out` by one message that decodes to exactly `transforms`. A name that starts with '/'
/// gets a second one, because readers drop the first. A decoded name keeps its own. `out` keeps its
/// capacity.
/// Threads: reentrant. Throws, with `index`, and leaves `out` as it was: InvalidStamp (negative, or
/// past the format's seconds: 2^32 - 1 in ROS 1, 2^31 - 1 in CDR), InvalidName (embedded NUL),
/// InvalidArgument (a message of 4 GiB or more).
void encode_tf_message(std::span<const TransformView> transforms, Encoding encoding,
                       std::vector<std::byte>& out);

}  // namespace tfdb::wire
