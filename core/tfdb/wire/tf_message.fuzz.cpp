// libFuzzer over the decoder and the encoder: the first byte selects the encoding, the rest is the
// message. It needs no corpus: the mutator creates valid messages and damages them.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "tfdb/wire/tf_message.hpp"
#include "tfdb/wire/tf_message.samples.hpp"

// NOLINTBEGIN(readability-identifier-naming): libFuzzer chose these names.

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

namespace tfdb::wire {

namespace {

using testing::kAllEncodings;
using testing::same_bits;

void require(bool holds, const char* what) {
    if (!holds) {
        std::fprintf(stderr, "violated: %s\n", what);
        std::abort();
    }
}

bool decodes(std::span<const std::byte> data, Encoding encoding, std::vector<TransformView>& out) {
    try {
        decode_tf_message(data, encoding, out);
        return true;
    } catch (const CorruptMessage& error) {
        require(out.empty(), "the output of a refused message is empty");
        require(error.detail().offset.value() <= data.size(), "the offset lies in the message");
        return false;
    }
}

void check_contents(std::span<const std::byte> data, std::span<const TransformView> transforms) {
    const char* const begin = reinterpret_cast<const char*>(data.data());
    const char* const end = begin + data.size();
    for (const TransformView& transform : transforms) {
        for (const std::string_view name : {transform.parent, transform.child}) {
            require(name.data() >= begin && name.data() + name.size() <= end,
                    "names lie in the message");
        }
    }
}

// Each encoding represents everything that any encoding accepts: exactly, and in one canonical
// form.
void check_round_trip(std::span<const TransformView> transforms, Encoding accepted) {
    static std::vector<std::byte> bytes;
    static std::vector<std::byte> again;
    static std::vector<TransformView> copy;
    for (const Encoding encoding : kAllEncodings) {
        try {
            encode_tf_message(transforms, encoding, bytes);
        } catch (const InvalidStamp&) {
            require(accepted == Encoding::kRos1, "only ROS 1 has stamps that do not fit others");
            continue;
        }
        require(decodes(bytes, encoding, copy), "what was written can be read");
        require(same_bits(transforms, copy), "a round trip is exact");
        encode_tf_message(copy, encoding, again);
        require(bytes == again, "writing is deterministic");
    }
}

// Overwrites an aligned word, where counts, lengths and stamps lie, with a special number.
void damage_word(std::uint8_t* data, std::size_t size, std::mt19937& random) {
    constexpr std::uint32_t kTelling[] = {0,          1,          2,          4,
                                          0x7fffffff, 0x80000000, 0xffffffff, 999999999,
                                          1000000000, 0x01000000, 0xfffffffc, 0x00000100};
    const std::size_t at = 1 + random() % (size - 4);
    std::uint32_t word = kTelling[random() % std::size(kTelling)];
    if (random() % 3 == 0) {
        std::memcpy(&word, data + at, sizeof word);
        word += random() % 2 == 0 ? 1U : ~0U;
    }
    std::memcpy(data + at, &word, sizeof word);
}

std::size_t make_message(std::uint8_t* data, std::size_t max_size, std::mt19937& random) {
    const std::size_t chosen = random() % std::size(kAllEncodings);
    const testing::RandomMessage message = testing::random_message(random);
    std::vector<std::byte> bytes;
    encode_tf_message(message.transforms, kAllEncodings[chosen], bytes);
    const std::size_t size = std::min(bytes.size(), max_size - 1);
    data[0] = static_cast<std::uint8_t>(chosen);
    std::memcpy(data + 1, bytes.data(), size);
    return size + 1;
}

}  // namespace

}  // namespace tfdb::wire

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace tfdb::wire;
    static std::vector<TransformView> out;
    if (size == 0) {
        return 0;
    }
    const Encoding encoding = kAllEncodings[data[0] % std::size(kAllEncodings)];
    const auto message = std::as_bytes(std::span(data + 1, size - 1));
    if (decodes(message, encoding, out)) {
        check_contents(message, out);
        std::erase_if(out, tfdb::wire::testing::is_bad);
        check_round_trip(out, encoding);
    }
    return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t max_size, unsigned seed) {
    using namespace tfdb::wire;
    std::mt19937 random(seed);
    if (random() % 8 == 0 || size < 8) {
        size = make_message(data, max_size, random);
    }
    if (random() % 3 == 0 && size >= 8) {
        damage_word(data, size, random);
        return size;
    }
    return random() % 16 == 0 ? size : LLVMFuzzerMutate(data, size, max_size);
}

// NOLINTEND(readability-identifier-naming)
