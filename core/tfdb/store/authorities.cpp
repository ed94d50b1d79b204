#include "tfdb/store/authorities.hpp"

#include <algorithm>
#include <mutex>
#include <utility>

#include "tfdb/base/error.hpp"
#include "tfdb/graph/names.hpp"

namespace tfdb::store {

Authorities::Authorities() {
    most_.store_relaxed(kFew);
    serial_.store_relaxed(next_serial());
}

std::uint64_t Authorities::next_serial() {
    static sync::Word serials{};
    return serials.fetch_add(1) + 1;
}

std::uint64_t Authorities::id(std::string_view name) {
    struct Last {
        std::uint64_t serial = 0;
        std::uint64_t id = 0;
        std::string name;
    };
    static thread_local Last last;
    if (name.empty())
        return 0;
    const std::uint64_t serial = serial_.load_relaxed();
    if (last.serial != serial || last.name != name) {
        const std::uint64_t found = find_or_add(name);
        last.serial = 0;  // until all three are of one name
        last.name = name;
        last.id = found;
        last.serial = serial;
    }
    return last.id;
}

void Authorities::share(memory::Region& region, sync::Word& newest) {
    region_ = &region;
    newest_ = &newest;
    most_.store_relaxed(kMostShared);
}

std::uint64_t Authorities::find_or_add(std::string_view name) {
    const std::lock_guard guard(lock_);
    auto known = ids_.find(name);
    if (known == ids_.end() && region_ != nullptr) {
        learn();
        known = ids_.find(name);
    }
    if (known != ids_.end())
        return known->second;
    if (region_ != nullptr)
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
    count_.store_relaxed(ids_.size());
    last_id_ = id;
}

void Authorities::list(std::string_view name, std::uint64_t id) {
    if (id > kMostShared) {
        throw CapacityExceeded("the store has " + std::to_string(kMostShared) +
                               " authorities already: use fewer names");
    }
    const Offset block = region_->allocate(Listed::bytes(name.size()));
    const auto word = [&](Offset at) -> sync::Word& { return region_->word(block + at); };
    word(Listed::kNext).store_relaxed(newest_->load_relaxed());
    word(Listed::kNumber).store_relaxed(id);
    word(Listed::kSize).store_relaxed(name.size());
    graph::store_text(*region_, block + Listed::kText, name);
    newest_->store_release(block);
}

void Authorities::learn() {
    struct Found {
        std::uint64_t id;
        std::string name;
    };
    std::vector<Found> found;
    // Numbers that fall, and blocks that do not overlap: only what was damaged has others.
    Offset left = region_->end();
    std::uint64_t before = kMostShared + 1;
    for (Offset block = region_->inside(newest_->load_acquire()); block != 0;) {
        const auto word = [&](Offset at) { return region_->word(block + at).load_relaxed(); };
        const std::uint64_t id = word(Listed::kNumber);
        const std::uint64_t size = word(Listed::kSize);
        if (id <= last_id_ || id >= before || size > left || Listed::bytes(size) > left)
            break;
        left -= Listed::bytes(size);
        before = id;
        found.push_back({id, graph::load_text(*region_, block + Listed::kText, size)});
        block = region_->inside(word(Listed::kNext));
    }
    for (; !found.empty(); found.pop_back())
        enter(found.back().name, found.back().id);
}

std::optional<std::string> Authorities::name(std::uint64_t id) {
    if (id == 0)
        return std::string();
    const std::lock_guard guard(lock_);
    auto found = names_.find(id);
    if (found == names_.end() && region_ != nullptr) {
        learn();
        found = names_.find(id);
        if (found == names_.end())
            return std::string();  // none that processes which write by the rules could leave
    }
    return found == names_.end() ? std::nullopt : std::optional(*found->second);
}

void Authorities::keep_only(std::vector<std::uint64_t> ids, std::size_t spare) {
    std::sort(ids.begin(), ids.end());
    const std::lock_guard guard(lock_);
    std::erase_if(names_, [&](const auto& entry) {
        return !std::binary_search(ids.begin(), ids.end(), entry.first);
    });
    std::erase_if(ids_, [&](const auto& entry) { return !names_.contains(entry.second); });
    count_.store_relaxed(ids_.size());
    most_.store_relaxed(2 * ids_.size() + spare + kFew);
    serial_.store_relaxed(next_serial());
}

std::size_t Authorities::bytes() const {
    constexpr std::size_t kNode = 2 * sizeof(void*);  // what a table keeps beside each entry
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
