#include "tfdb/store/validate.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace tfdb::store {
namespace {

ErrorDetail detail_of(const TransformView& transform, std::size_t index,
                      std::string_view authority) {
    ErrorDetail detail;
    detail.edge = transform.child;
    detail.parent = transform.parent;
    detail.authority = authority;
    detail.index = index;
    return detail;
}

std::string by(std::string_view authority) {
    return authority.empty() ? std::string() : " from " + quoted(authority);
}

std::string edge_name(const TransformView& transform) {
    return transform_name(transform.parent, transform.child);
}

/// Whether the bytes are valid UTF-8: no overlong forms, no surrogates, nothing beyond U+10FFFF.
bool is_utf8(std::string_view text) {
    for (std::size_t i = 0; i < text.size();) {
        const auto byte = [&](std::size_t at) {
            return at < text.size() ? static_cast<unsigned char>(text[at]) : 0U;
        };
        const unsigned lead = byte(i++);
        if (lead < 0x80)
            continue;
        if (lead < 0xC2 || lead > 0xF4)
            return false;
        // Only the second byte's range depends on the first byte.
        const unsigned low = lead == 0xE0 ? 0xA0 : lead == 0xF0 ? 0x90 : 0x80;
        const unsigned high = lead == 0xED ? 0x9F : lead == 0xF4 ? 0x8F : 0xBF;
        if (byte(i) < low || byte(i) > high)
            return false;
        const std::size_t end = i + (lead < 0xE0 ? 1U : lead < 0xF0 ? 2U : 3U);
        while (++i < end) {
            if ((byte(i) & 0xC0) != 0x80)
                return false;
        }
    }
    return true;
}

/// The part of a message about a frame that belongs to a source.
std::string read_only_of(std::string_view source) {
    return " is read-only here: it comes from source " + quoted(source) + ". forget_source(" +
           quoted(source) + ") makes it writable";
}

}  // namespace

bool is_text(std::string_view name) noexcept {
    unsigned seen = 0;
    for (const char c : name) {
        if (c == '\0')
            return false;
        seen |= static_cast<unsigned char>(c);
    }
    return seen < 0x80 || is_utf8(name);
}

const char* name_fault(std::string_view name) noexcept {
    if (name.empty())
        return "is empty";
    if (name.size() > kMaxNameBytes)
        return "is longer than 1024 bytes";
    unsigned seen = 0;
    for (const char c : name) {
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F)
            return "has a control character";
        seen |= static_cast<unsigned char>(c);
    }
    // Other bytes would make every later listing of the frames fail in Python.
    return seen < 0x80 || is_utf8(name) ? nullptr : "is not valid UTF-8";
}

namespace {

Fault fault_of_name(std::string_view name, const char* role, const TransformView& transform,
                    std::size_t index, std::string_view authority) {
    const char* fault = name_fault(name);
    if (fault == nullptr)
        return std::nullopt;
    ErrorDetail detail = detail_of(transform, index, authority);
    detail.frame = name;
    detail.reason = fault;
    return InvalidName(
        std::string(role) + " frame name " + quoted(name) + by(authority) + " " + fault + kNameRule,
        std::move(detail));
}

Error invalid_transform(const TransformView& transform, std::size_t index,
                        std::string_view authority, const std::string& reason) {
    ErrorDetail detail = detail_of(transform, index, authority);
    detail.stamp = transform.stamp;
    detail.reason = reason;
    return InvalidTransform(edge_name(transform) + " at " + seconds(transform.stamp) +
                                by(authority) + " was refused: " + reason,
                            std::move(detail));
}

bool is_timely(const TransformView& transform, bool is_static) {
    return is_static ? transform.stamp >= 0 : clock::is_stamp(transform.stamp);
}

template <ErrorCode Code>
void throw_if(ErrorCode code, const std::string& message, ErrorDetail& detail) {
    if (code == Code)
        throw ErrorOf<Code>(message, std::move(detail));
}

/// Throws the class of the code: one of the errors with which a write may be refused.
[[noreturn]] void throw_typed(ErrorCode code, const std::string& message, ErrorDetail detail) {
    throw_if<ErrorCode::kInvalidTransform>(code, message, detail);
    throw_if<ErrorCode::kInvalidStamp>(code, message, detail);
    throw_if<ErrorCode::kInvalidName>(code, message, detail);
    throw_if<ErrorCode::kTooOld>(code, message, detail);
    throw_if<ErrorCode::kStaticConflict>(code, message, detail);
    throw_if<ErrorCode::kRepeatedStamp>(code, message, detail);
    throw_if<ErrorCode::kCycle>(code, message, detail);
    throw_if<ErrorCode::kUnknownFrame>(code, message, detail);
    throw_if<ErrorCode::kFrameInUse>(code, message, detail);
    throw_if<ErrorCode::kReadOnly>(code, message, detail);
    throw Error(code, message, std::move(detail));
}

}  // namespace

bool is_sound(std::span<const TransformView> batch, bool is_static) noexcept {
    for (const TransformView& transform : batch) {
        if (transform.parent == transform.child || !is_timely(transform, is_static) ||
            !is_finite(transform.pose.translation) || !is_rotation(transform.pose.rotation)) {
            return false;
        }
    }
    return true;
}

bool has_sound_names(const TransformView& transform) noexcept {
    return name_fault(transform.parent) == nullptr && name_fault(transform.child) == nullptr;
}

void check_may_exist(std::string_view name, const char* what) {
    const char* const fault = name_fault(name);
    if (fault == nullptr)
        return;
    ErrorDetail detail;
    detail.frame = name;
    detail.reason = fault;
    throw InvalidName(std::string(what) + " frame name " + quoted(name) + " " + fault + kNameRule,
                      std::move(detail));
}

void check_may_exist(const Question& question) {
    const auto check = [](const FrameRef& frame, const char* what) {
        if (frame.name.data() != nullptr)
            check_may_exist(frame.name, what);
    };
    check(question.target, "the wait would never end: the target");
    check(question.source, "the wait would never end: the source");
    if (question.kind == Question::kFull)
        check(question.fixed, "the wait would never end: the fixed");
}

namespace {

/// Cut when long, control characters escaped.
std::string shown(std::string_view name) {
    constexpr std::size_t kShown = 64;
    std::string text;
    for (const char c : name.substr(0, kShown)) {
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) {
            char escape[5];
            std::snprintf(escape, sizeof escape, "\\x%02x", static_cast<unsigned char>(c));
            text += escape;
        } else {
            text += c;
        }
    }
    if (name.size() > kShown)
        text += "...";
    return text;
}

/// For T[target<-source]: quoted if the brackets or the arrow could be misread otherwise.
std::string shown_in_brackets(std::string_view name) {
    const bool plain = !name.empty() && name.find_first_of(" '[]<") == std::string_view::npos;
    return plain ? shown(name) : quoted(name);
}

}  // namespace

std::string quoted(std::string_view name) {
    return "'" + shown(name) + "'";
}

std::string transform_name(std::string_view target, std::string_view source) {
    return "T[" + shown_in_brackets(target) + "<-" + shown_in_brackets(source) + "]";
}

std::string seconds(StampNs stamp) {
    char text[40];
    const char* sign = stamp < 0 ? "-" : "";
    const auto magnitude =
        stamp < 0 ? 0 - static_cast<std::uint64_t>(stamp) : static_cast<std::uint64_t>(stamp);
    std::snprintf(text, sizeof text, "%s%llu.%09llu s", sign,
                  static_cast<unsigned long long>(magnitude / 1'000'000'000U),
                  static_cast<unsigned long long>(magnitude % 1'000'000'000U));
    return text;
}

std::string likely_meant(StampNs stamp, StampNs oldest, StampNs newest) {
    constexpr StampNs kSecond = 1'000'000'000;
    constexpr StampNs kDay = 86'400;
    constexpr StampNs kMostSeconds = history::kForever / kSecond;
    if (stamp == 0)
        return "; time 0 is an ordinary stamp here: for the latest, pass no time";
    if (stamp < oldest && stamp <= kMostSeconds && (stamp + 1) * kSecond > oldest &&
        stamp * kSecond <= newest + kDay * kSecond)
        return "; stamps are nanoseconds, " + std::to_string(stamp) + " looks like seconds";
    if (stamp > 0 && stamp <= newest - oldest && oldest - stamp > newest - oldest) {
        // A number this small is in seconds, if the data are as long.
        constexpr StampNs kMillisecond = 1'000'000;
        const bool is_seconds = stamp < kMillisecond && stamp <= (newest - oldest) / kSecond;
        const StampNs after = is_seconds ? stamp * kSecond : stamp;
        return "; stamps are absolute: " + seconds(after) + " after its first sample is " +
               seconds(oldest + after);
    }
    const StampNs whole = stamp / kSecond;
    if (stamp > newest && newest > 0 && whole > 0 && std::abs(whole - newest) <= kDay)
        return "; stamps are nanoseconds, those of this edge look like seconds";
    return {};
}

Fault fault_alone(const TransformView& transform, std::size_t index, bool is_static,
                  std::string_view authority) {
    if (const auto excess = clock::excess_of(transform.stamp)) {
        ErrorDetail detail = detail_of(transform, index, authority);
        detail.reason = std::to_string(*excess) + " nanoseconds are a second or more";
        const std::string text = "the stamp of " + edge_name(transform) + by(authority) +
                                 " was refused: " + detail.reason;
        return InvalidStamp(text, std::move(detail));
    }
    if (!is_timely(transform, is_static)) {
        ErrorDetail detail = detail_of(transform, index, authority);
        detail.stamp = transform.stamp;
        if (transform.stamp < 0)
            detail.reason = "negative";
        return InvalidStamp(
            "stamp " + std::to_string(transform.stamp) + " ns of " + edge_name(transform) +
                by(authority) +
                " is out of range: stamps are from 0 to 2^61 - 1 ns (the year 2043)",
            std::move(detail));
    }
    if (transform.parent == transform.child)
        return invalid_transform(transform, index, authority, "a frame cannot be its own parent");
    if (!is_finite(transform.pose.translation))
        return invalid_transform(transform, index, authority, "its translation is not finite");
    const geometry::Quat& q = transform.pose.rotation;
    if (is_rotation(q))
        return std::nullopt;
    char text[160];
    std::snprintf(
        text, sizeof text,
        "its quaternion (%g, %g, %g, %g) has a squared norm of %g, which must be within 0.01 of 1",
        q.x, q.y, q.z, q.w, geometry::norm_squared(q));
    return invalid_transform(transform, index, authority, text);
}

Fault fault_of_names(const TransformView& transform, std::size_t index,
                     std::string_view authority) {
    Fault fault = fault_of_name(transform.parent, "parent", transform, index, authority);
    return fault ? fault : fault_of_name(transform.child, "child", transform, index, authority);
}

Fault fault_of_edge(const Store& store, FrameId child, const TransformView& transform,
                    std::size_t index, bool is_static, std::string_view authority,
                    WriteRules rules) {
    if (is_storable(store, child, transform, is_static, rules))
        return std::nullopt;
    if (const auto source = store.writer_of(child))
        return read_only(transform, index, *source, authority);
    const history::EdgeWriter<StoreMemory> edge(store.frames.memory(), store.frames.header(child));
    if (changes_kind(edge, is_static))
        return static_conflict(transform, index, is_static, authority,
                               ", or pass change_kind=True, which drops its stored samples");
    if (transform.stamp < edge.newest() - store.history)
        return too_old(transform, index, edge.newest(), store.history, authority);
    return repeated_stamp(transform, index, authority);
}

bool has_stamp(const Store& store, FrameId child, StampNs stamp) {
    history::EdgeView<StoreMemory> edge;
    history::Bracket around;
    return edge.open(store.frames.memory(), store.frames.header(child), store.committed(),
                     store.history, history::kAsItIs) &&
           edge.bracket(stamp, around) && around.before.stamp == stamp;
}

Error static_conflict(const TransformView& transform, std::size_t index, bool is_static,
                      std::string_view authority, const char* other_way) {
    ErrorDetail detail = detail_of(transform, index, authority);
    detail.stamp = transform.stamp;
    const char* const kind = is_static ? "static" : "moving";
    const char* const stored = is_static ? "moving" : "static";
    const std::string child = quoted(transform.child);
    return StaticConflict(edge_name(transform) + by(authority) + " is " + kind +
                              ", but the stored edge of " + child + " is " + stored +
                              ": remove frame " + child + " first" + other_way,
                          std::move(detail));
}

Error read_only(const TransformView& transform, std::size_t index, std::string_view source,
                std::string_view authority) {
    ErrorDetail detail = detail_of(transform, index, authority);
    detail.stamp = transform.stamp;
    detail.frame = transform.child;
    detail.source = source;
    return ReadOnly(edge_name(transform) + " at " + seconds(transform.stamp) + by(authority) +
                        " was refused: frame " + quoted(transform.child) + read_only_of(source),
                    std::move(detail));
}

Error repeated_stamp(const TransformView& transform, std::size_t index,
                     std::string_view authority) {
    ErrorDetail detail = detail_of(transform, index, authority);
    detail.stamp = transform.stamp;
    return RepeatedStamp(edge_name(transform) + " at " + seconds(transform.stamp) + by(authority) +
                             " was refused: a sample of that stamp exists, and only_new keeps it",
                         std::move(detail));
}

Error too_old(const TransformView& transform, std::size_t index, StampNs newest, StampNs history,
              std::string_view authority) {
    ErrorDetail detail = detail_of(transform, index, authority);
    detail.stamp = transform.stamp;
    detail.newest = newest;
    detail.oldest = newest - history;
    detail.limit = history;
    return TooOld(
        edge_name(transform) + " at " + seconds(transform.stamp) + by(authority) +
            " is older than the retained history, which begins at " + seconds(newest - history) +
            (transform.stamp == 0 ? "" : likely_meant(transform.stamp, newest - history, newest)),
        std::move(detail));
}

Error unknown_frame(std::string_view name, std::size_t index, const std::string& hint) {
    ErrorDetail detail;
    detail.frame = name;
    detail.index = index;
    return UnknownFrame("frame " + quoted(name) + " does not exist: nothing was removed" + hint,
                        std::move(detail));
}

ReadOnly read_only_frame(std::string_view name, std::optional<std::size_t> index,
                         std::string_view source) {
    ErrorDetail detail;
    detail.frame = name;
    detail.index = index;
    detail.source = source;
    return ReadOnly("frame " + quoted(name) + read_only_of(source), std::move(detail));
}

Error frame_in_use(std::string_view name, std::size_t index, std::vector<std::string> children,
                   const std::string& advice) {
    constexpr std::size_t kNamedChildren = 8;
    std::string list;
    for (std::size_t i = 0; i < std::min(children.size(), kNamedChildren); ++i)
        list += (i == 0 ? "" : ", ") + quoted(children[i]);
    if (children.size() > kNamedChildren)
        list += ", ...";
    ErrorDetail detail;
    detail.frame = name;
    detail.index = index;
    detail.frames = std::move(children);
    return FrameInUse("frame " + quoted(name) + " is the parent of " + list + ": " + advice,
                      std::move(detail));
}

Error used_frame(std::string_view name, std::size_t index, const std::optional<std::string>& source,
                 std::vector<std::string> children) {
    if (source)
        return read_only_frame(name, index, *source);
    return frame_in_use(name, index, std::move(children),
                        "remove those first, or pass recursive=True");
}

Error cycle_fault(const TransformView& transform, std::size_t index, bool is_static,
                  std::string_view authority) {
    ErrorDetail detail = detail_of(transform, index, authority);
    detail.stamp = transform.stamp;
    detail.frames = {std::string(transform.child), std::string(transform.parent)};
    const std::string edge = is_static ? "static " + edge_name(transform)
                                       : edge_name(transform) + " at " + seconds(transform.stamp);
    return CycleError(
        edge + by(authority) + " would make " + quoted(transform.child) + " its own ancestor",
        std::move(detail));
}

void Refusals::sort() {
    std::sort(errors_.begin(), errors_.end(), [](const Error& a, const Error& b) {
        return a.detail().index.value_or(0) < b.detail().index.value_or(0);
    });
}

std::vector<RefusedMember> Refusals::members() {
    sort();
    std::vector<RefusedMember> members;
    members.reserve(errors_.size());
    for (const Error& error : errors_) {
        members.push_back(
            {error.detail().index.value_or(0), error.code(), error.what(), error.detail().reason});
    }
    return members;
}

void Refusals::raise(const std::string& of) {
    std::vector<RefusedMember> refused = members();
    Error& first = errors_.front();
    ErrorDetail detail = std::move(first.detail());
    std::string message = first.what();
    if (refused.size() > 1) {
        message = std::to_string(refused.size()) + " of " + of +
                  " were refused, the first at index " + std::to_string(*detail.index) + ": " +
                  message;
    }
    if (first.code() == ErrorCode::kCycle)
        message += ": nothing was stored";
    detail.refused = std::move(refused);
    throw_typed(first.code(), message, std::move(detail));
}

}  // namespace tfdb::store
