#include "tfdb/testing/sched/fiber.hpp"

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <exception>
#include <new>
#include <utility>

#if !defined(__x86_64__)
#include <ucontext.h>
#endif

namespace tfdb::sched {

namespace {

constexpr std::size_t kStackBytes = 256 * 1024;

// The fiber whose body is about to start: a fresh stack has no other access to it.
Fiber* g_entering = nullptr;

/// A stack with an unmapped page below it, so that an overflow faults at once.
void* map_stack() {
    void* base = mmap(nullptr, kStackBytes, PROT_READ | PROT_WRITE,
                      MAP_PRIVATE | MAP_ANONYMOUS | MAP_STACK, -1, 0);
    if (base == MAP_FAILED) {
        throw std::bad_alloc();
    }
    const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
    mprotect(base, page, PROT_NONE);
    return base;
}

}  // namespace

#if defined(__x86_64__)

// Saves the callee-saved registers and the stack pointer, and loads those of the other side. It
// makes no system call: a walk switches tens of millions of times, and swapcontext() makes two of
// them per switch.
extern "C" void tfdb_sched_switch(void** save, void* load);
asm(R"(
.text
.p2align 4
.globl tfdb_sched_switch
.type tfdb_sched_switch,@function
tfdb_sched_switch:
    pushq %rbp
    pushq %rbx
    pushq %r12
    pushq %r13
    pushq %r14
    pushq %r15
    movq %rsp, (%rdi)
    movq %rsi, %rsp
    popq %r15
    popq %r14
    popq %r13
    popq %r12
    popq %rbx
    popq %rbp
    ret
.size tfdb_sched_switch,.-tfdb_sched_switch
)");

struct Fiber::Machine {
    void* stack = map_stack();
    void* inside = nullptr;
    void* outside = nullptr;

    void prepare(void (*entry)()) {
        auto* top = reinterpret_cast<std::uintptr_t*>(static_cast<char*>(stack) + kStackBytes);
        *--top = 0;  // the return address of the entry: unwinding ends here
        *--top = reinterpret_cast<std::uintptr_t>(entry);
        for (int saved_register = 0; saved_register < 6; ++saved_register) {
            *--top = 0;
        }
        inside = top;
    }
    void go_in() { tfdb_sched_switch(&outside, inside); }
    void go_out() { tfdb_sched_switch(&inside, outside); }
};

#else

struct Fiber::Machine {
    void* stack = map_stack();
    ucontext_t inside{};
    ucontext_t outside{};

    void prepare(void (*entry)()) {
        getcontext(&inside);
        inside.uc_stack.ss_sp = stack;
        inside.uc_stack.ss_size = kStackBytes;
        inside.uc_link = nullptr;
        makecontext(&inside, entry, 0);
    }
    void go_in() { swapcontext(&outside, &inside); }
    void go_out() { swapcontext(&inside, &outside); }
};

#endif

Fiber::Fiber() : machine_(new Machine) {}

Fiber::~Fiber() {
    munmap(machine_->stack, kStackBytes);
    delete machine_;
}

void Fiber::start(std::function<void()> body) {
    body_ = std::move(body);
    finished_ = false;
    machine_->prepare(&Fiber::enter);
}

void Fiber::resume() {
    g_entering = this;
    machine_->go_in();
}

void Fiber::suspend() {
    machine_->go_out();
}

void Fiber::enter() {
    Fiber* const self = g_entering;
    try {
        self->body_();
    } catch (...) {
        std::terminate();
    }
    self->finished_ = true;
    self->machine_->go_out();
    std::terminate();  // a finished fiber is never resumed
}

}  // namespace tfdb::sched
