// libFuzzer over samples of commits and states: what is applied leaves a sound store, what is
// refused leaves it as it was.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "tfdb/store/buffer.hpp"
#include "tfdb/wire/crc32c.hpp"

// NOLINTBEGIN(readability-identifier-naming): libFuzzer chose these names.

namespace {

void require(bool holds, const char* what) {
    if (!holds) {
        std::fprintf(stderr, "violated: %s\n", what);
        std::abort();
    }
}

tfdb::BufferOptions small() {
    tfdb::BufferOptions options;
    options.max_frames = 64;
    options.memory_limit = std::size_t{8} << 20;
    return options;
}

void check(const tfdb::Buffer& buffer) {
    for (const tfdb::FrameInfo& info : buffer.tree()) {
        const tfdb::Samples samples = buffer.samples(info.name);
        for (const tfdb::Pose& pose : samples.poses)
            require(std::isfinite(pose.translation.x) && std::isfinite(pose.rotation.w),
                    "stored poses are finite");
        std::string at = info.name;
        for (std::size_t steps = 0; const auto parent = buffer.parent_of(at); at = *parent)
            require(++steps <= 64, "parents end at a root");
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size < 36)
        return 0;
    const auto* const bytes = reinterpret_cast<const std::byte*>(data);
    std::vector<std::byte> sample(bytes, bytes + size);
    // Else hardly any input would get beyond it.
    const std::uint32_t sum = tfdb::wire::crc32c(std::span(sample).first(size - 4));
    for (std::size_t i = 0; i < 4; ++i)
        sample[size - 4 + i] = std::byte(sum >> (8 * i));
    tfdb::Buffer buffer(small());
    const tfdb::TransformView mine[] = {{"map", "base", 5, {}}};
    buffer.set_transforms(mine, false, "local");
    for (int times = 0; times < 2; ++times) {
        const auto before = buffer.positions();
        const tfdb::CommitNumber commit = buffer.commit();
        try {
            (void)buffer.apply(sample);
        } catch (const tfdb::Error&) {
            require(buffer.commit() > commit || buffer.positions() == before,
                    "a refused sample leaves the position as it was");
        }
        check(buffer);
    }
    return 0;
}

// NOLINTEND(readability-identifier-naming)
