// The clock of a store.
#include "tfdb/store/clock.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <optional>
#include <string>
#include <utility>

#include "arguments.hpp"
#include "errors.hpp"
#include "names.hpp"
#include "reads.hpp"
#include "signatures.hpp"
#include "stamp.hpp"

namespace tfdb::python {
namespace {

/// The object behind the Python class Clock.
/// Threads: the holder of the GIL; `clock` any. Guarantee: immutable.
struct ClockObject {
    Clock clock;
    nb::object owner;  // the Buffer object
};

nb::object clock_of(nb::handle self) {
    Clock made = object_of<BufferObject>(self).open_store().clock();
    nb::object object = nb::inst_alloc(nb::type<ClockObject>());
    new (nb::inst_ptr<ClockObject>(object)) ClockObject{std::move(made), nb::borrow(self)};
    nb::inst_mark_ready(object);
    return object;
}

/// Throws BufferClosed.
const Clock& open_clock(nb::handle self) {
    const ClockObject& object = object_of<ClockObject>(self);
    static_cast<void>(object_of<BufferObject>(object.owner).open_store());
    return object.clock;
}

template <class Change>
void change(nb::handle self, Change change) {
    const Clock& clock = open_clock(self);
    const Waiting work;
    change(clock);
}

bool sleep_to(nb::handle self, StampNs stamp, nb::handle timeout,
              std::optional<std::uint64_t> settings = std::nullopt) {
    const Clock& clock = open_clock(self);
    const std::optional<StampNs> longest = optional_duration_of(timeout, "timeout");
    const nb::object owner = object_of<ClockObject>(self).owner;
    const Waiting work;
    return clock.sleep_until(stamp, longest, settings);
}

bool sleep_until(nb::handle self, nb::handle stamp, nb::handle timeout) {
    return sleep_to(self, stamp_of(stamp.ptr()), timeout);
}

/// For a player: False also if the clock was set more often.
bool sleep_unless_set(nb::handle self, nb::handle stamp, nb::handle timeout,
                      std::uint64_t settings) {
    return sleep_to(self, stamp_of(stamp.ptr()), timeout, settings);
}

bool sleep(nb::handle self, nb::handle seconds, nb::handle timeout) {
    const StampNs passed = duration_of(seconds, "seconds");
    const StampNs now = open_clock(self).now();
    return sleep_to(self, clock::saturating_add(now, passed), timeout);
}

void set_speed(nb::handle self, nb::handle speed) {
    const double wanted = PyFloat_AsDouble(speed.ptr());
    if (wanted == -1.0 && PyErr_Occurred() != nullptr)
        throw nb::python_error();
    change(self, [wanted](const Clock& clock) { clock.set_speed(wanted); });
}

std::string describe(nb::handle self) {
    const ClockObject& object = object_of<ClockObject>(self);
    const std::optional<ClockSetting> set = object.clock.setting();
    if (!set)
        return "<tfdb.Clock of the system>";
    const std::string at = std::to_string(object.clock.now());
    if (set->paused)
        return "<tfdb.Clock, paused at " + at + ">";
    return "<tfdb.Clock at " + at + ", speed " + nb::str(nb::float_(set->speed)).c_str() + ">";
}

// A buffer's clock function may refer to objects that hold its clocks: as for snapshots.
int traverse_clock(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (nb::inst_ready(self)) {
        Py_VISIT(nb::inst_ptr<ClockObject>(self)->owner.ptr());
    }
    return 0;
}

PyType_Slot g_clock_slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse_clock)},
    {0, nullptr},
};

constexpr const char* kClassDoc = R"(Clock()
--

The clock of a store. `Buffer.clock` returns it.

It shows the system's time until it is set. All processes that have a shared store open share one
clock: if one sets it, the sleeps of all react. `max_age=` of `lookup_latest_transform` uses it. A player (`tfdb
play`) sets it.

A process that may not write to the store's control file sees the system's clock. So does every
frozen store.)";

constexpr const char* kSleepUntilDoc = R"(Sleep until the clock shows a stamp, or a later one.

A paused clock reaches no later stamp. The sleep reacts at once to a pause, a seek and a change of
speed.

Parameters
----------
stamp
    Nanoseconds.
timeout
    Longest wait in seconds of real time; None: no limit.

Returns
-------
bool
    False: the timeout passed first.

Raises
------
InvalidStamp, BufferClosed (also if `close` was called meanwhile), NoSuchStore (the shared store was
removed))";

constexpr const char* kSleepDoc = R"(Sleep for a number of seconds of this clock.

Parameters
----------
seconds
    Seconds of this clock: at double speed they pass in half the time.
timeout
    As in `sleep_until`.

Returns
-------
bool
    False: the timeout passed first.

Raises
------
InvalidArgument, BufferClosed, NoSuchStore
    As `sleep_until`.)";

constexpr const char* kSeekDoc =
    R"(Set the clock to a stamp. A running clock continues from there; a paused one stays paused.

Parameters
----------
stamp
    Nanoseconds.

Raises
------
InvalidStamp, ReadOnly, LockTimeout, BufferClosed, TransactionActive)";

constexpr const char* kSettingRaises = R"(

Raises
------
ReadOnly, LockTimeout, BufferClosed, TransactionActive)";

std::string setting_doc(const char* text) {
    return std::string(text) + kSettingRaises;
}

void bind_settings(nb::class_<ClockObject>& made) {
    made.def(
        "seek",
        [](nb::handle self, nb::handle stamp) {
            change(self, [time = stamp_of(stamp.ptr())](const Clock& clock) { clock.seek(time); });
        },
        nb::arg("stamp"), nb::sig("def seek(self, stamp: tfdb.types.StampLike) -> None"), kSeekDoc);
    made.def(
        "pause", [](nb::handle self) { change(self, [](const Clock& clock) { clock.pause(); }); },
        nb::sig("def pause(self) -> None"),
        setting_doc("Pause the clock. A second call does nothing.").c_str());
    made.def(
        "resume", [](nb::handle self) { change(self, [](const Clock& clock) { clock.resume(); }); },
        nb::sig("def resume(self) -> None"), setting_doc("Resume a paused clock.").c_str());
    made.def(
        "follow_system",
        [](nb::handle self) { change(self, [](const Clock& clock) { clock.follow_system(); }); },
        nb::sig("def follow_system(self) -> None"),
        setting_doc("Set the clock back to the system's time.").c_str());
    made.def_prop_rw(
        "speed",
        [](nb::handle self) {
            const auto set = open_clock(self).setting();
            return set ? set->speed : 1.0;
        },
        &set_speed, nb::for_getter(nb::sig("def speed(self) -> float")),
        nb::for_setter(nb::sig("def speed(self, speed: float, /) -> None")),
        "Seconds of this clock per real second; must be positive. Raises as `pause`, and "
        "InvalidArgument.");
}

/// Functions for src/tfdb/player and the command line.
void bind_for_players(nb::class_<ClockObject>& made) {
    made.def_prop_ro(
        "_set_to",
        [](nb::handle self) {
            const Clock& clock = open_clock(self);
            const auto set = clock.setting();
            return set ? set->time : clock.now();
        },
        nb::sig("def _set_to(self) -> int"), "What the clock showed when it was set last.");
    made.def_prop_ro(
        "_set_since",
        [](nb::handle self) -> std::optional<std::int64_t> {
            const auto set = open_clock(self).setting();
            return set ? std::optional(set->since) : std::nullopt;
        },
        nb::sig("def _set_since(self) -> int | None"),
        "When it was set last, as `time.monotonic_ns` counts; None: it follows the system.");
    made.def_prop_ro(
        "_settings", [](nb::handle self) { return open_clock(self).settings(); },
        nb::sig("def _settings(self) -> int"), "How often the clock was set.");
    made.def("_sleep_unless_set", &sleep_unless_set, nb::arg("stamp"), nb::arg("timeout").none(),
             nb::arg("settings"),
             nb::sig("def _sleep_unless_set(self, stamp: int, timeout: float | None, settings: "
                     "int) -> bool"),
             "As `sleep_until`; False, too, once the clock was set more than `settings` times.");
}

}  // namespace

void bind_clock(nb::module_& module, nb::class_<BufferObject, StoreReaderObject>& type) {
    type.def_prop_ro("clock", &clock_of, nb::sig("def clock(self) -> Clock"),
                     "Clock of the store, the same for all processes that have it open. A function "
                     "given as `clock=` replaces it in the lookups of this Buffer.");
    auto made = offered_class<nb::class_<ClockObject>>(module, "Clock", kClassDoc,
                                                       nb::type_slots(g_clock_slots));
    refuse_construction<ClockObject>(made, "Buffer.clock makes clocks");
    made.def(
        "now", [](nb::handle self) { return open_clock(self).now(); },
        nb::sig("def now(self) -> int"), "Return what the clock shows, nanoseconds.");
    made.def("sleep", &sleep, nb::arg("seconds"), nb::arg("timeout").none() = nb::none(),
             nb::sig("def sleep(self, seconds: float, timeout: float | None = None) -> bool"),
             kSleepDoc);
    made.def("sleep_until", &sleep_until, nb::arg("stamp"), nb::arg("timeout").none() = nb::none(),
             nb::sig("def sleep_until(self, stamp: tfdb.types.StampLike, timeout: float | "
                     "None = None) -> bool"),
             kSleepUntilDoc);
    bind_settings(made);
    made.def_prop_ro(
        "paused",
        [](nb::handle self) {
            const auto set = open_clock(self).setting();
            return set && set->paused;
        },
        nb::sig("def paused(self) -> bool"), "Whether the clock is paused.");
    made.def_prop_ro(
        "is_system", [](nb::handle self) { return !open_clock(self).setting(); },
        nb::sig("def is_system(self) -> bool"), "Whether the clock shows the system's time.");
    bind_for_players(made);
    made.def("__repr__", &describe);
}

}  // namespace tfdb::python
