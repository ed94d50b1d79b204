// tfdb._core: the table of contents of the extension.
#include <nanobind/nanobind.h>

#include "arrays.hpp"
#include "errors.hpp"
#include "fields.hpp"
#include "reads.hpp"
#include "transform.hpp"

namespace nb = nanobind;

NB_MODULE(_core, module) {
    // A policy or a buffer in a global of the user's is alive at exit, and no leak.
    nb::set_leak_warnings(false);
    module.doc() = "The compiled part of tfdb. Use the names that `tfdb` exports.";
    module.attr("__version__") = TFDB_VERSION;
    tfdb::python::bind_fields();
    tfdb::python::bind_arrays();
    tfdb::python::bind_errors(module);
    tfdb::python::bind_policy(module);
    tfdb::python::bind_transform(module);
    tfdb::python::bind_reads(module);
    tfdb::python::bind_buffer(module);
    tfdb::python::add_python_methods(module);
}
