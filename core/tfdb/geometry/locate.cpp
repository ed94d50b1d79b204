#include "tfdb/geometry/locate.hpp"

#include <algorithm>
#include <bit>

namespace tfdb::geometry {

namespace {

/// Halving steps in a bucket beyond which the table is no better than a plain binary search.
constexpr int kMostSteps = 5;

/// The cursor pays when a sample is passed at least every so many stamps; it also does when there
/// are so many more samples than stamps that a table over them would cost more than it saves.
constexpr std::size_t kDense = 2;
constexpr std::size_t kSparse = 4;

/// Stamps that the cursor looks at together.
constexpr std::size_t kStretch = 16;

/// The first position in [from, end) of a rising sequence whose value is above `stamp`: doubling
/// steps from the front, then a binary search.
std::size_t first_above(const StampNs* values, std::size_t from, std::size_t end, StampNs stamp) {
    std::size_t step = 1;
    while (from + step <= end && values[from + step - 1] <= stamp) {
        from += step;
        step *= 2;
    }
    const StampNs* found =
        std::upper_bound(values + from, values + std::min(from + step, end), stamp);
    return static_cast<std::size_t>(found - values);
}

}  // namespace

QueryRange describe(std::span<const StampNs> queries) noexcept {
    QueryRange range;
    range.count = queries.size();
    if (queries.empty()) {
        return range;
    }
    range.least = range.greatest = queries.front();
    std::size_t falls = 0;
    for (std::size_t i = 1; i < queries.size(); ++i) {
        falls += queries[i] < queries[i - 1] ? 1 : 0;
        range.least = queries[i] < range.least ? queries[i] : range.least;
        range.greatest = queries[i] > range.greatest ? queries[i] : range.greatest;
    }
    range.sorted = falls == 0;
    return range;
}

std::size_t sample_before(const StampNs* stamps, std::size_t size, StampNs stamp) noexcept {
    std::size_t at = 0;
    std::size_t length = size;
    while (length > 1) {
        const std::size_t half = length / 2;
        at = stamps[at + half] <= stamp ? at + half : at;
        length -= half;
    }
    return at;
}

void Locator::prepare(const StampNs* stamps, std::size_t size, const QueryRange& queries) {
    stamps_ = stamps;
    size_ = size;
    low_ = std::min(sample_before(stamps, size, queries.least), size - 2);
    high_ = std::min(sample_before(stamps, size, queries.greatest) + 1, size - 1);
    cursor_ = low_;
    const std::size_t samples = high_ - low_ + 1;
    if (queries.sorted &&
        (queries.count >= kDense * samples || samples > kSparse * queries.count)) {
        method_ = Method::kCursor;
    } else if (samples <= kSparse * queries.count && make_table()) {
        method_ = Method::kBuckets;
    } else {
        method_ = queries.sorted ? Method::kCursor : Method::kBinary;
    }
}

void Locator::locate(const StampNs* queries, std::size_t count, std::uint32_t* index) noexcept {
    switch (method_) {
        case Method::kCursor:
            walk(queries, count, index);
            break;
        case Method::kBuckets:
            look_up_any(queries, count, index);
            break;
        case Method::kBinary:
            bisect(queries, count, index);
            break;
    }
}

void Locator::walk(const StampNs* queries, std::size_t count, std::uint32_t* index) noexcept {
    const std::size_t last = size_ - 2;
    std::size_t at = cursor_;
    std::size_t done = 0;
    while (done < count) {
        if (at < last && stamps_[at + 1] <= queries[done]) {
            ++at;
            if (at < last && stamps_[at + 1] <= queries[done]) {
                at = std::min(first_above(stamps_, at + 2, size_, queries[done]) - 1, last);
            }
        }
        const auto entry = static_cast<std::uint32_t>(at);
        if (at == last || queries[count - 1] < stamps_[at + 1]) {
            std::fill(index + done, index + count, entry);
            break;
        }
        const StampNs next = stamps_[at + 1];
        // Short runs without a branch on their length: a whole stretch is written, the next run
        // overwrites what was too much.
        if (done + kStretch <= count) {
            std::size_t below = 0;
            for (std::size_t k = 0; k < kStretch; ++k) {
                below += queries[done + k] < next ? 1 : 0;
                index[done + k] = entry;
            }
            done += below;
            if (below < kStretch) {
                continue;
            }
        }
        const std::size_t end = first_above(queries, done, count, next - 1);
        std::fill(index + done, index + end, entry);
        done = end;
    }
    cursor_ = at;
}

// Bucket b holds the stamps with (stamp - base) >> shift == b, base being the lowest sample's. The
// table has for each bucket the last sample before it; what is left of the search are `steps_`
// halvings over the samples inside the bucket, the same number for every stamp.
bool Locator::make_table() {
    const std::size_t samples = high_ - low_ + 1;
    const StampNs base = stamps_[low_];
    const auto span = static_cast<std::uint64_t>(stamps_[high_] - base);
    shift_ = 0;
    while ((span >> shift_) >= 2 * samples) {
        ++shift_;
    }
    const std::size_t buckets = static_cast<std::size_t>(span >> shift_) + 1;
    if (table_.size() < buckets) {
        table_.resize(buckets);
    }
    std::size_t filled = 0;  // buckets of which the entry is known
    std::size_t most = 0;
    for (std::size_t i = low_; i <= high_; ++i) {
        const auto bucket = static_cast<std::size_t>((stamps_[i] - base) >> shift_);
        if (bucket < filled) {
            most = std::max(most, i - table_[bucket]);
            continue;
        }
        const auto before = static_cast<std::uint32_t>(i > low_ ? i - 1 : i);
        std::fill(table_.begin() + static_cast<std::ptrdiff_t>(filled),
                  table_.begin() + static_cast<std::ptrdiff_t>(bucket) + 1, before);
        filled = bucket + 1;
        most = std::max(most, i - before);
    }
    steps_ = static_cast<int>(std::bit_width(most));
    const std::size_t reach = (std::size_t{1} << steps_) - 1;
    if (steps_ > kMostSteps || reach >= samples) {
        return false;
    }
    // No step may look beyond the last sample.
    const auto latest = static_cast<std::uint32_t>(high_ - reach);
    for (std::size_t b = buckets; b-- > 0 && table_[b] > latest;) {
        table_[b] = latest;
    }
    return true;
}

template <int Steps>
void Locator::look_up(const StampNs* queries, std::size_t count,
                      std::uint32_t* index) const noexcept {
    const StampNs base = stamps_[low_];
    const StampNs top = stamps_[high_];
    const auto last = static_cast<std::uint32_t>(size_ - 2);
    for (std::size_t i = 0; i < count; ++i) {
        const StampNs query = std::clamp(queries[i], base, top);
        std::uint32_t at = table_[static_cast<std::size_t>((query - base) >> shift_)];
        for (int k = Steps - 1; k >= 0; --k) {
            const std::uint32_t step = 1U << k;
            at += stamps_[at + step] <= query ? step : 0;
        }
        index[i] = std::min(at, last);
    }
}

void Locator::look_up_any(const StampNs* queries, std::size_t count,
                          std::uint32_t* index) const noexcept {
    switch (steps_) {
        case 1:
            look_up<1>(queries, count, index);
            break;
        case 2:
            look_up<2>(queries, count, index);
            break;
        case 3:
            look_up<3>(queries, count, index);
            break;
        case 4:
            look_up<4>(queries, count, index);
            break;
        default:
            look_up<kMostSteps>(queries, count, index);
            break;
    }
}

void Locator::bisect(const StampNs* queries, std::size_t count,
                     std::uint32_t* index) const noexcept {
    const std::size_t last = size_ - 2;
    for (std::size_t i = 0; i < count; ++i) {
        const std::size_t at = low_ + sample_before(stamps_ + low_, high_ - low_ + 1, queries[i]);
        index[i] = static_cast<std::uint32_t>(std::min(at, last));
    }
}

}  // namespace tfdb::geometry
