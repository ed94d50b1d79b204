// Threads that Python ends while they run code of this module.
//
// Before Python 3.14, a thread that requests the GIL of a finalizing interpreter is ended with
// pthread_exit. glibc then unwinds its stack, through C++ frames that must not be unwound:
// destructors would access Python objects without the GIL, and `noexcept` ends the process. Newer
// versions let such a thread sleep for ever. This file does the same, at the first frame of this
// module.
#ifdef TFDB_WRAPS_PERSONALITY

#include <unistd.h>
#include <unwind.h>

#include "tfdb/store/transaction.hpp"

namespace tfdb::python {

/// The C++ runtime's personality routine: its decision for a frame during unwinding.
_Unwind_Reason_Code real_personality(
    int version, _Unwind_Action actions, _Unwind_Exception_Class kind, _Unwind_Exception* exception,
    _Unwind_Context* context) __asm__("__real___gxx_personality_v0");

/// The personality routine of all frames of this module; the linker wraps it.
_Unwind_Reason_Code personality(int version, _Unwind_Action actions, _Unwind_Exception_Class kind,
                                _Unwind_Exception* exception,
                                _Unwind_Context* context) __asm__("__wrap___gxx_personality_v0");

_Unwind_Reason_Code personality(int version, _Unwind_Action actions, _Unwind_Exception_Class kind,
                                _Unwind_Exception* exception, _Unwind_Context* context) {
    if ((actions & _UA_FORCE_UNWIND) != 0) {
        Transaction::end_thread();  // so that no other thread waits for it
        for (;;) {
            pause();
        }
    }
    return real_personality(version, actions, kind, exception, context);
}

}  // namespace tfdb::python

#endif
