// Runs operations on the real tf2::BufferCore (ROS 1, libtf2-dev): one operation per line of
// standard input, one answer per line of standard output. Built and driven by
// tests/compat/tf2_oracle.py.
//
// Times are nanoseconds, 0 asks for the latest common time. Numbers of poses are written as
// hexadecimal floats, so that nothing is rounded. Frame names contain no blanks.
//
//   reset CACHE_NS                                   ok
//   set STATIC STAMP PARENT CHILD x y z qx qy qz qw  ok | refused
//   get TARGET SOURCE TIME                           pose STAMP x y z qx qy qz qw | error CLASS
//   TEXT full TARGET TIME SOURCE TIME FIXED               the same can TARGET SOURCE TIME yes | no
//   canfull TARGET TIME SOURCE TIME FIXED            the same
//   latest TARGET SOURCE                             stamp STAMP | error CLASS TEXT
//   parent FRAME TIME                                parent NAME | none
//   clear                                            ok

#include <console_bridge/console.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TF2Error.h>

#include <cstdint>
#include <cstdio>
#include <iostream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>

namespace {

ros::Time time_of(std::uint64_t ns) {
    ros::Time time;
    time.fromNSec(ns);
    return time;
}

// One line, whatever the text of an error contains.
std::string flat(std::string text) {
    for (char& c : text) {
        if (c == '\n') {
            c = ' ';
        }
    }
    return text;
}

std::string error(const char* kind, const std::exception& e) {
    return std::string("error ") + kind + " " + flat(e.what());
}

template <class Function>
std::string guarded(Function answer) {
    try {
        return answer();
    } catch (const tf2::ConnectivityException& e) {
        return error("connectivity", e);
    } catch (const tf2::LookupException& e) {
        return error("lookup", e);
    } catch (const tf2::ExtrapolationException& e) {
        return error("extrapolation", e);
    } catch (const tf2::InvalidArgumentException& e) {
        return error("invalid", e);
    } catch (const tf2::TransformException& e) {
        return error("transform", e);
    }
}

std::string pose_answer(const geometry_msgs::TransformStamped& result) {
    const auto& t = result.transform.translation;
    const auto& q = result.transform.rotation;
    char text[256];
    std::snprintf(text, sizeof text, "pose %llu %a %a %a %a %a %a %a",
                  static_cast<unsigned long long>(result.header.stamp.toNSec()), t.x, t.y, t.z, q.x,
                  q.y, q.z, q.w);
    return text;
}

class Driver {
public:
    std::string answer(const std::string& line) {
        std::istringstream in(line);
        std::string verb;
        in >> verb;
        if (verb == "reset") {
            const auto cache = number(in);
            buffer_ = std::make_unique<tf2::BufferCore>(
                ros::Duration().fromNSec(static_cast<std::int64_t>(cache)));
            return "ok";
        }
        if (verb == "set") {
            return set(in);
        }
        if (verb == "clear") {
            buffer_->clear();
            return "ok";
        }
        if (verb == "latest") {
            return latest(in);
        }
        if (verb == "parent") {
            const auto frame = word(in);
            std::string parent;
            return buffer_->_getParent(frame, time_of(number(in)), parent) ? "parent " + parent
                                                                           : "none";
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

    static std::uint64_t number(std::istream& in) { return std::stoull(word(in)); }
    static double real(std::istream& in) { return std::stod(word(in)); }

    std::string set(std::istream& in) {
        const bool is_static = number(in) != 0;
        geometry_msgs::TransformStamped message;
        message.header.stamp = time_of(number(in));
        message.header.frame_id = word(in);
        message.child_frame_id = word(in);
        auto& t = message.transform.translation;
        auto& q = message.transform.rotation;
        for (double* value : {&t.x, &t.y, &t.z, &q.x, &q.y, &q.z, &q.w}) {
            *value = real(in);
        }
        return buffer_->setTransform(message, "driver", is_static) ? "ok" : "refused";
    }

    std::string latest(std::istream& in) {
        const auto target = word(in);
        const auto source = word(in);
        return guarded([&] {
            ros::Time time;
            std::string text;
            const auto id_of = [&](const std::string& frame) {
                return buffer_->_validateFrameId("latest", frame);
            };
            const int code =
                buffer_->_getLatestCommonTime(id_of(target), id_of(source), time, &text);
            if (code == tf2_msgs::TF2Error::CONNECTIVITY_ERROR) {
                throw tf2::ConnectivityException(text);
            }
            if (code != tf2_msgs::TF2Error::NO_ERROR) {
                throw tf2::TransformException(text);
            }
            return "stamp " + std::to_string(time.toNSec());
        });
    }

    std::string read(const std::string& verb, std::istream& in) {
        const auto target = word(in);
        if (verb == "get" || verb == "can") {
            const auto source = word(in);
            const auto time = time_of(number(in));
            if (verb == "can") {
                return buffer_->canTransform(target, source, time) ? "yes" : "no";
            }
            return guarded(
                [&] { return pose_answer(buffer_->lookupTransform(target, source, time)); });
        }
        if (verb == "full" || verb == "canfull") {
            const auto target_time = time_of(number(in));
            const auto source = word(in);
            const auto source_time = time_of(number(in));
            const auto fixed = word(in);
            if (verb == "canfull") {
                return buffer_->canTransform(target, target_time, source, source_time, fixed)
                           ? "yes"
                           : "no";
            }
            return guarded([&] {
                return pose_answer(
                    buffer_->lookupTransform(target, target_time, source, source_time, fixed));
            });
        }
        throw std::invalid_argument("unknown operation " + verb);
    }

    std::unique_ptr<tf2::BufferCore> buffer_ = std::make_unique<tf2::BufferCore>();
};

}  // namespace

int main() {
    console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_NONE);
    std::ios::sync_with_stdio(false);
    Driver driver;
    std::string line;
    while (std::getline(std::cin, line)) {
        std::cout << driver.answer(line) << '\n';
    }
    return 0;
}
