// Removing frames.
#include <algorithm>
#include <mutex>

#include "tfdb/store/impl.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb {
namespace {

constexpr std::size_t kNamedChildren = 8;

/// The frame and all below it, by newest parents.
std::vector<FrameId> subtree(const Reads::Impl& impl, const StoreCommit& commit, FrameId root) {
    std::vector<std::vector<FrameId>> children(impl.frames.count());
    const StoreView view = commit.view();
    for (FrameId id = 0; id < impl.frames.count(); ++id) {
        if (!view.alive(id))
            continue;
        const FrameId parent = commit.newest_parent(id);
        if (parent != kNoFrame)
            children[parent].push_back(id);
    }
    std::vector<FrameId> found{root};
    for (std::size_t i = 0; i < found.size(); ++i) {
        const auto& below = children[found[i]];
        found.insert(found.end(), below.begin(), below.end());
    }
    return found;
}

[[noreturn]] void throw_in_use(const Reads::Impl& impl, const StoreCommit& commit, FrameId frame,
                               std::string_view name) {
    ErrorDetail detail;
    detail.frame = name;
    const StoreView view = commit.view();
    std::string children;
    for (FrameId id = 0; id < impl.frames.count(); ++id) {
        if (!view.alive(id) || commit.newest_parent(id) != frame)
            continue;
        detail.frames.push_back(impl.names.name(id));
        if (detail.frames.size() > kNamedChildren)
            continue;
        children += (children.empty() ? "" : ", ") + store::quoted(detail.frames.back());
    }
    if (detail.frames.size() > kNamedChildren)
        children += ", ...";
    throw FrameInUse("frame " + store::quoted(name) + " is the parent of " + children +
                         ": remove those first, or pass recursive=True",
                     std::move(detail));
}

}  // namespace

CommitNumber Buffer::remove_frame(std::string_view name, bool recursive) {
    const std::lock_guard guard(impl_->lock);
    StoreCommit commit = impl_->start_commit();
    const FrameId id = impl_->names.find(name, commit.number());
    if (id == kNoFrame) {
        ErrorDetail detail;
        detail.frame = name;
        throw UnknownFrame("frame " + store::quoted(name) + " does not exist: nothing was removed",
                           std::move(detail));
    }
    const bool used = impl_->frames.word(id, history::kChildren).load_relaxed() != 0;
    if (used && !recursive)
        throw_in_use(*impl_, commit, id, name);
    const std::vector<FrameId> frames =
        used ? subtree(*impl_, commit, id) : std::vector<FrameId>{id};
    for (const FrameId frame : frames)
        commit.remove(frame);
    return commit.publish();
}

}  // namespace tfdb
