#include "tfdb/store/authorities.hpp"

#include <algorithm>
#include <mutex>

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

std::uint64_t Authorities::find_or_add(std::string_view name) {
    const std::lock_guard guard(lock_);
    const auto known = ids_.find(name);
    if (known != ids_.end())
        return known->second;
    const auto added = ids_.emplace(name, last_id_ + 1).first;
    try {
        names_.emplace(last_id_ + 1, &added->first);
    } catch (...) {
        ids_.erase(added);
        throw;
    }
    count_.store_relaxed(ids_.size());
    return ++last_id_;
}

std::optional<std::string> Authorities::name(std::uint64_t id) const {
    if (id == 0)
        return std::string();
    const std::lock_guard guard(lock_);
    const auto found = names_.find(id);
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
