#include "tfdb/store/authorities.hpp"

#include <mutex>
#include <utility>

#include "tfdb/base/error.hpp"
#include "tfdb/graph/names.hpp"

namespace tfdb::store {

namespace {

std::uint64_t next_serial() {
    static sync::Word serials{};
    return serials.fetch_add(1) + 1;
}

}  // namespace

Authorities::Authorities(memory::Region& region, sync::Word& newest)
    : serial_(next_serial()), region_(region), newest_(newest) {}

std::uint64_t Authorities::id(std::string_view name) {
    struct Last {
        std::uint64_t serial = 0;
        std::uint64_t id = 0;
        std::string name;
    };
    static thread_local Last last;
    if (name.empty())
        return 0;
    if (last.serial != serial_ || last.name != name) {
        const std::uint64_t found = find_or_add(name);
        last.serial = 0;  // until all three belong to one name
        last.name = name;
        last.id = found;
        last.serial = serial_;
    }
    return last.id;
}

std::uint64_t Authorities::find_or_add(std::string_view name) {
    const std::lock_guard guard(lock_);
    auto known = ids_.find(name);
    if (known == ids_.end()) {
        learn();
        known = ids_.find(name);
    }
    if (known != ids_.end())
        return known->second;
    list(name, last_id_ + 1);
    enter(name, last_id_ + 1);
    return last_id_;
}

void Authorities::enter(std::string_view name, std::uint64_t id) {
    const auto added = ids_.emplace(name, id).first;
    try {
        names_.emplace(id, &added->first);
    } catch (...) {
        ids_.erase(added);
        throw;
    }
    last_id_ = id;
}

void Authorities::list(std::string_view name, std::uint64_t id) {
    if (id >= kMost) {
        throw CapacityExceeded("the store already has " + std::to_string(kMost - 1) +
                               " authorities, the limit: use fewer names");
    }
    const Offset block = region_.allocate(Listed::bytes(name.size()));
    const auto word = [&](Offset at) -> sync::Word& { return region_.word(block + at); };
    word(Listed::kNext).store_relaxed(newest_.load_relaxed());
    word(Listed::kNumber).store_relaxed(id);
    word(Listed::kSize).store_relaxed(name.size());
    graph::store_text(region_, block + Listed::kText, name);
    newest_.store_release(block);
}

void Authorities::learn() {
    struct Found {
        std::uint64_t id;
        std::string name;
    };
    std::vector<Found> found;
    // Offsets descend and blocks do not overlap, unless the list is damaged.
    Offset left = region_.end();
    std::uint64_t before = kMost;
    for (Offset block = region_.inside(newest_.load_acquire()); block != 0;) {
        const auto word = [&](Offset at) { return region_.word(block + at).load_relaxed(); };
        const std::uint64_t id = word(Listed::kNumber);
        const std::uint64_t size = word(Listed::kSize);
        if (id <= last_id_ || id >= before || size > left || Listed::bytes(size) > left)
            break;
        left -= Listed::bytes(size);
        before = id;
        found.push_back({id, graph::load_text(region_, block + Listed::kText, size)});
        block = region_.inside(word(Listed::kNext));
    }
    for (; !found.empty(); found.pop_back())
        enter(found.back().name, found.back().id);
}

std::string Authorities::name(std::uint64_t id) {
    if (id == 0)
        return {};
    const std::lock_guard guard(lock_);
    auto found = names_.find(id);
    if (found == names_.end()) {
        learn();
        found = names_.find(id);
    }
    return found == names_.end() ? std::string() : *found->second;
}

std::size_t Authorities::bytes() const {
    constexpr std::size_t kNode = 2 * sizeof(void*);  // overhead of a table entry
    const std::lock_guard guard(lock_);
    std::size_t bytes = sizeof(void*) * (ids_.bucket_count() + names_.bucket_count());
    for (const auto& entry : ids_) {
        const std::string& name = entry.first;
        const bool apart = name.capacity() > std::string().capacity();
        bytes += sizeof(entry) + sizeof(decltype(names_)::value_type) + 2 * kNode +
                 (apart ? name.capacity() + 1 : 0);
    }
    return bytes;
}

}  // namespace tfdb::store
