// Signals during long calls.
#include "errors.hpp"
#include "reads.hpp"

namespace tfdb::python {
namespace {

constexpr std::size_t kStepsBetween = 256;

/// Python runs signal handlers only in this thread.
unsigned long g_main_thread = 0;

}  // namespace

void bind_signals() {
    const nb::object main = nb::module_::import_("threading").attr("main_thread")();
    g_main_thread = nb::cast<unsigned long>(main.attr("ident"));
}

LongWork::LongWork(bool release, std::chrono::milliseconds between)
    : before_(current()), release_(release), between_(between), next_(Clock::now() + between) {
    current() = PyThread_get_thread_ident() == g_main_thread ? this : nullptr;
    if (release_) {
        state_ = PyEval_SaveThread();
    }
}

LongWork::~LongWork() {
    current() = before_;
    if (state_ != nullptr) {
        PyEval_RestoreThread(state_);
    }
}

void LongWork::ask() {
    if (Clock::now() < next_) {
        return;
    }
    if (state_ != nullptr) {
        PyEval_RestoreThread(state_);
        state_ = nullptr;
    }
    {
        const NotInterrupted handlers_may_call_us;
        if (PyErr_CheckSignals() != 0) {
            throw nb::python_error();  // with the GIL
        }
    }
    next_ = Clock::now() + between_;
    if (release_) {
        state_ = PyEval_SaveThread();
    }
}

void look_for_signals(std::size_t step) {
    if (step % kStepsBetween == 0 && PyErr_CheckSignals() != 0) {
        throw nb::python_error();
    }
}

}  // namespace tfdb::python
