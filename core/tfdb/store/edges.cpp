// The edges of many frames in one call, all in one state.
#include <optional>

#include "tfdb/store/freshness.hpp"
#include "tfdb/store/question_resolver.hpp"
#include "tfdb/store/rows.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb {

using lookup::Outcome;

template <class Real>
void StoreReader::lookup_edges(std::span<FrameRef> frames, std::optional<StampNs> stamp,
                               Policy policy, Missing missing, std::span<Real> out) const {
    store::check_room<Real>(frames, out);
    Question question = store::of_edges(stamp, policy);
    Answer answer;
    Failure failure;
    std::size_t at = 0;
    // Without a pin, writers that overtake a long batch would restart it.
    std::optional<store::ReadPin> pin;
    if (store_->engine == nullptr && frames.size() > store::kEdgesBetweenEnds)
        pin.emplace(*store_);
    const bool found = store::read(*store_, held_, [&](const StoreView& view) {
        const auto find = [&](std::string_view name) {
            return store_->names.find(name, view.commit());
        };
        const auto name_of = [&](FrameId id) { return store_->names.name(id); };
        bool complete = true;
        for (at = 0; at < frames.size(); ++at) {
            if (at % store::kEdgesBetweenEnds == 0)
                interruption_point();
            question.source = frames[at];
            const Outcome looked_up =
                store::QuestionResolver(view, find, question).answer(answer, failure);
            const Outcome outcome =
                store::unless_stale(*store_, view, name_of, question, looked_up, failure);
            const bool is_there = outcome == Outcome::kOk;
            if (outcome == Outcome::kLapped || (!is_there && missing == Missing::kThrow))
                return outcome;
            complete &= is_there;
            frames[at].handle = question.source.handle;
            store::write_row(is_there ? &answer.pose : nullptr, out.data() + 7 * at);
        }
        // A frame may be missing because its slot was reused since.
        return complete ? Outcome::kOk : store::unless_reused(*store_, view.commit(), Outcome::kOk);
    });
    if (!found)
        store::raise_at(*this, failure, question, at);
}

template void StoreReader::lookup_edges(std::span<FrameRef>, std::optional<StampNs>, Policy,
                                        Missing, std::span<float>) const;
template void StoreReader::lookup_edges(std::span<FrameRef>, std::optional<StampNs>, Policy,
                                        Missing, std::span<double>) const;

}  // namespace tfdb
