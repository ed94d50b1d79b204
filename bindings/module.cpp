// tfdb._core: the table of contents of the extension.
#include <nanobind/nanobind.h>

#include "commit_messages.hpp"
#include "errors.hpp"
#include "fields.hpp"
#include "messages.hpp"
#include "reads.hpp"
#include "signatures.hpp"
#include "tf2/calls.hpp"
#include "transform.hpp"

namespace nb = nanobind;

// Renames nanobind's entry point, which the one below calls.
#define PyInit__core tfdb_make_core
NB_MODULE(_core, module) {
    // A policy or a buffer in a user's global variable is alive at exit, but not a leak.
    nb::set_leak_warnings(false);
    module.doc() = "The compiled part of tfdb. Use the names that `tfdb` exports.";
    module.attr("__version__") = TFDB_VERSION;
    tfdb::python::bind_fields();
    tfdb::python::bind_errors(module);
    tfdb::python::bind_signals();
    tfdb::python::bind_policy(module);
    tfdb::python::bind_transform(module);
    tfdb::python::bind_adaptive(module);
    tfdb::python::bind_reads(module);
    tfdb::python::bind_buffer(module);
    tfdb::python::bind_messages(module);
    tfdb::python::bind_tf2_calls(module);
    tfdb::python::bind_helpers(module);
    tfdb::python::bind_sample_rows(module);
    tfdb::python::bind_commit_messages(module);
    tfdb::python::add_signatures(module);
}
#undef PyInit__core

// NOLINTBEGIN(bugprone-reserved-identifier,readability-identifier-naming): Python chose the name.
// This module's Python references (types, interned names, numpy's parts) belong to one interpreter.
extern "C" NB_EXPORT PyObject* PyInit__core() {
    if (PyInterpreterState_GetID(PyInterpreterState_Get()) != 0) {
        PyErr_SetString(PyExc_ImportError,
                        "tfdb can be imported in the main interpreter only: no sub-interpreter is "
                        "supported; use threads, or processes");
        return nullptr;
    }
    return tfdb_make_core();
}
// NOLINTEND(bugprone-reserved-identifier,readability-identifier-naming)
