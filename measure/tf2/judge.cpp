// tfdb_tf2_judge: the real tf2 for the tests that compare with it. One operation per line of stdin,
// one answer per line of stdout; numbers of poses are hexadecimal floats, so that nothing is
// rounded. Frame names contain no blanks.
//
//   reset CACHE_NS                                   ok
//   set STATIC STAMP PARENT CHILD x y z qx qy qz qw  ok | refused
//   get TARGET SOURCE TIME                           pose STAMP x y z qx qy qz qw | error CLASS
//   TEXT full TARGET TIME SOURCE TIME FIXED               the same can TARGET SOURCE TIME yes | no
//   canfull TARGET TIME SOURCE TIME FIXED            the same
//   latest TARGET SOURCE                             stamp STAMP | error CLASS TEXT
//   parent FRAME TIME                                parent NAME | none
//   clear                                            ok

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>

#include "tf2.hpp"

namespace {

using real_tf2::Found;
using real_tf2::StampNs;
using real_tf2::Tf2;

constexpr StampNs kTenSeconds = 10'000'000'000;

/// The answer, or the class and text of the error in one line.
template <class Function>
std::string guarded(Function answer) {
    try {
        return answer();
    } catch (const std::exception& error) {
        const char* kind = real_tf2::kind_of(error);
        if (kind == nullptr) {
            throw;
        }
        std::string text = error.what();
        std::replace(text.begin(), text.end(), '\n', ' ');
        return std::string("error ") + kind + " " + text;
    }
}

std::string pose_answer(const Found& found) {
    const double* p = found.pose.values;
    char text[256];
    std::snprintf(text, sizeof text, "pose %lld %a %a %a %a %a %a %a",
                  static_cast<long long>(found.stamp), p[0], p[1], p[2], p[3], p[4], p[5], p[6]);
    return text;
}

// Threads: one. Guarantee: none.
class Judge {
public:
    std::string answer(const std::string& line) {
        std::istringstream in(line);
        const std::string verb = word(in);
        if (verb == "reset") {
            tf2_ = std::make_unique<Tf2>(number(in));
            return "ok";
        }
        if (verb == "clear") {
            tf2_->clear();
            return "ok";
        }
        if (verb == "set") {
            return set(in);
        }
        if (verb == "latest") {
            const auto target = word(in);
            const auto source = word(in);
            return guarded(
                [&] { return "stamp " + std::to_string(tf2_->latest_common(target, source)); });
        }
        if (verb == "parent") {
            const auto frame = word(in);
            std::string parent;
            return tf2_->parent(frame, number(in), parent) ? "parent " + parent : "none";
        }
        return read(verb, in);
    }

private:
    static std::string word(std::istream& in) {
        std::string text;
        if (!(in >> text)) {
            throw std::invalid_argument("missing word");
        }
        return text;
    }
    static StampNs number(std::istream& in) { return std::stoll(word(in)); }

    std::string set(std::istream& in) {
        const bool is_static = number(in) != 0;
        const StampNs stamp = number(in);
        const auto parent = word(in);
        const auto child = word(in);
        double pose[7];
        for (double& value : pose) {
            value = std::stod(word(in));
        }
        return tf2_->set(parent, child, stamp, pose, message_, is_static) ? "ok" : "refused";
    }

    std::string read(const std::string& verb, std::istream& in) {
        if (verb == "get" || verb == "can") {
            const auto target = word(in);
            const auto source = word(in);
            const StampNs stamp = number(in);
            if (verb == "can") {
                return tf2_->can(target, source, stamp) ? "yes" : "no";
            }
            return guarded([&] { return pose_answer(tf2_->get(target, source, stamp)); });
        }
        if (verb == "full" || verb == "canfull") {
            real_tf2::TwoTimes asked;
            asked.target = word(in);
            asked.target_stamp = number(in);
            asked.source = word(in);
            asked.source_stamp = number(in);
            asked.fixed = word(in);
            if (verb == "canfull") {
                return tf2_->can(asked) ? "yes" : "no";
            }
            return guarded([&] { return pose_answer(tf2_->get(asked)); });
        }
        throw std::invalid_argument("unknown operation " + verb);
    }

    std::unique_ptr<Tf2> tf2_ = std::make_unique<Tf2>(kTenSeconds);
    Tf2::Message message_;
};

}  // namespace

int main() {
    std::ios::sync_with_stdio(false);
    Judge judge;
    std::string line;
    while (std::getline(std::cin, line)) {
        std::cout << judge.answer(line) << '\n';
    }
    return 0;
}
