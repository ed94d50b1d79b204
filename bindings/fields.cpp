#include "fields.hpp"

namespace tfdb::python {

Fields g_fields;

void bind_fields() {
#define TFDB_INTERN(name)                              \
    g_fields.name = PyUnicode_InternFromString(#name); \
    if (g_fields.name == nullptr) {                    \
        throw nb::python_error();                      \
    }
    TFDB_FIELDS(TFDB_INTERN)
#undef TFDB_INTERN
}

}  // namespace tfdb::python
