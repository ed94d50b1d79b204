// Threads that Python ends while they are in this module.
//
// Before 3.14 a thread that wants the GIL of an interpreter that ends is made to leave with
// pthread_exit. glibc then unwinds its stack, through frames of C++ that must not be left like
// that: destructors would touch Python's objects without the GIL, and `noexcept` ends the process.
// Newer versions let such a thread sleep for ever; so does this, at the first frame of ours.
#ifdef TFDB_WRAPS_PERSONALITY

#include <unistd.h>
#include <unwind.h>

#include "tfdb/store/transaction.hpp"

namespace tfdb::python {

/// What the C++ runtime does with a frame on the way of an exception.
_Unwind_Reason_Code real_personality(
    int version, _Unwind_Action actions, _Unwind_Exception_Class kind, _Unwind_Exception* exception,
    _Unwind_Context* context) __asm__("__real___gxx_personality_v0");

/// All frames of this module ask this one: the linker is told to.
_Unwind_Reason_Code personality(int version, _Unwind_Action actions, _Unwind_Exception_Class kind,
                                _Unwind_Exception* exception,
                                _Unwind_Context* context) __asm__("__wrap___gxx_personality_v0");

_Unwind_Reason_Code personality(int version, _Unwind_Action actions, _Unwind_Exception_Class kind,
                                _Unwind_Exception* exception, _Unwind_Context* context) {
    if ((actions & _UA_FORCE_UNWIND) != 0) {
        Transaction::end_thread();  // no other thread may wait for it
        for (;;) {
            pause();
        }
    }
    return real_personality(version, actions, kind, exception, context);
}

}  // namespace tfdb::python

#endif
