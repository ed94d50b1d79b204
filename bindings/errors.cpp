#include "errors.hpp"

#include <nanobind/stl/string.h>

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "tfdb/store/validate.hpp"

namespace tfdb::python {
namespace {

// In the order of ErrorCode.
constexpr std::array kClassNames = {
    "UnknownFrame",
    "Disconnected",
    "Extrapolation",
    "GapTooLarge",
    "Stale",
    "NoSampleNear",
    "InvalidTransform",
    "TooOld",
    "StaticConflict",
    "RepeatedStamp",
    "CycleError",
    "FrameInUse",
    "InvalidStamp",
    "InvalidName",
    "InvalidArgument",
    "CorruptMessage",
    "SnapshotTooOld",
    "SnapshotClosed",
    "WatchClosed",
    "CapacityExceeded",
    "Conflict",
    "TransactionClosed",
    "TransactionActive",
    "WrongThread",
    "Forked",
    "FeedLapped",
    "Gone",
    "OutOfOrder",
    "Fenced",
    "NotSupported",
    "NoSuchStore",
    "StoreExists",
    "CorruptStore",
    "ReadOnly",
    "LockTimeout",
    "BufferClosed",
    "WaitTimeout",
};
static_assert(kClassNames.size() == static_cast<std::size_t>(ErrorCode::kWaitTimeout) + 1);

// Strong references for the life of the process.
std::array<PyObject*, kClassNames.size()> g_classes{};

void set_text(nb::handle error, const char* name, const std::string& value) {
    if (!value.empty()) {
        error.attr(name) = escaped(value);
    }
}

template <class Integer>
void set_number(nb::handle error, const char* name, const std::optional<Integer>& value) {
    if (value) {
        error.attr(name) = *value;
    }
}

void set_fields(nb::handle error, const ErrorDetail& detail) {
    set_text(error, "target", detail.target);
    set_text(error, "source", detail.source);
    set_text(error, "edge", detail.edge);
    set_text(error, "parent", detail.parent);
    set_text(error, "frame", detail.frame);
    set_text(error, "authority", detail.authority);
    set_text(error, "expectation", detail.expectation);
    set_text(error, "reason", detail.reason);
    set_text(error, "path", detail.path);
    set_number(error, "stamp", detail.stamp);
    set_number(error, "oldest", detail.oldest);
    set_number(error, "newest", detail.newest);
    set_number(error, "before", detail.before);
    set_number(error, "after", detail.after);
    set_number(error, "limit", detail.limit);
    set_number(error, "index", detail.index);
    set_number(error, "offset", detail.offset);
    set_number(error, "commit", detail.commit);
    set_number(error, "since", detail.since);
    set_number(error, "pid", detail.pid);
    if (!detail.frames.empty()) {
        nb::list names;
        for (const std::string& name : detail.frames) {
            names.append(escaped(name));
        }
        error.attr("frames") = nb::tuple(names);
    }
    if (!detail.refused.empty()) {
        nb::list members;
        for (const RefusedMember& member : detail.refused) {
            members.append(refused_record(member));
        }
        error.attr("refused") = nb::tuple(members);
    }
}

/// An instance created without its __init__, which would only store the fields again.
nb::object new_error(nb::handle type, const std::string& message) {
    const nb::tuple arguments = nb::make_tuple(escaped(message));
    auto* kind = reinterpret_cast<PyTypeObject*>(type.ptr());
    const auto make = reinterpret_cast<newfunc>(PyType_GetSlot(kind, Py_tp_new));
    PyObject* value = make(kind, arguments.ptr(), nullptr);
    if (value == nullptr) {
        throw nb::python_error();
    }
    nb::object made = nb::steal(value);
    made.attr("args") = arguments;  // the __new__ of system errors does not set them
    return made;
}

}  // namespace

void bind_errors(nb::module_& module) {
    const nb::module_ errors = nb::module_::import_("tfdb.data.errors");
    for (std::size_t i = 0; i < kClassNames.size(); ++i) {
        g_classes[i] = nb::object(errors.attr(kClassNames[i])).release().ptr();
    }
    nb::register_exception_translator([](const std::exception_ptr& pointer, void*) {
        try {
            std::rethrow_exception(pointer);
        } catch (const Error& error) {
            set_error(error);
        }
    });
    static_cast<void>(module);
}

const char* class_name(ErrorCode code) {
    return kClassNames[static_cast<std::size_t>(code)];
}

nb::object error_object(const Error& error) {
    const nb::handle type = g_classes[static_cast<std::size_t>(error.code())];
    nb::object value = new_error(type, error.what());
    set_fields(value, error.detail());
    if (error.code() == ErrorCode::kUnknownFrame) {
        value.attr("frame") = escaped(error.detail().frame);  // even the empty name
    }
    return value;
}

void throw_object(const nb::object& error) {
    PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(error.ptr())), error.ptr());
    throw nb::python_error();
}

nb::str escaped(std::string_view text) {
    PyObject* const decoded =
        PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "backslashreplace");
    if (decoded == nullptr) {
        throw nb::python_error();
    }
    return nb::steal<nb::str>(decoded);
}

nb::str str_of_name(std::string_view name) {
    PyObject* const decoded =
        PyUnicode_DecodeUTF8(name.data(), static_cast<Py_ssize_t>(name.size()), nullptr);
    if (decoded != nullptr) {
        return nb::steal<nb::str>(decoded);
    }
    if (PyErr_ExceptionMatches(PyExc_UnicodeDecodeError) == 0) {
        throw nb::python_error();
    }
    PyErr_Clear();
    throw_error(
        "CorruptStore",
        "the store is damaged: the name of a frame is not valid UTF-8; create the store again, "
        "or freeze the recording again",
        {{"reason", nb::str("a name is not valid UTF-8")}});
}

nb::object name_or_none(const std::optional<std::string>& name) {
    return name ? nb::object(str_of_name(*name)) : nb::none();
}

nb::object refused_record(const RefusedMember& member) {
    const nb::object type = nb::module_::import_("tfdb.data.types").attr("Refused");
    const std::string& reason = member.reason.empty() ? member.message : member.reason;
    return type(member.index, class_name(member.code), escaped(member.message), escaped(reason));
}

void set_error(const Error& error) noexcept {
    try {
        const nb::object value = error_object(error);
        PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(value.ptr())), value.ptr());
    } catch (nb::python_error& failed) {
        failed.restore();
    }
}

void throw_error(const char* class_name, const std::string& message,
                 std::initializer_list<Field> fields) {
    const nb::object type = nb::module_::import_("tfdb.data.errors").attr(class_name);
    const nb::object value = type(escaped(message));
    for (const auto& [name, field] : fields) {
        value.attr(name) = field;
    }
    PyErr_SetObject(type.ptr(), value.ptr());
    throw nb::python_error();
}

bool is_tfdb_error(const nb::python_error& error) {
    const nb::object root = nb::module_::import_("tfdb.data.errors").attr("TfdbError");
    return nb::isinstance(error.value(), root);
}

void add_index(nb::python_error& error, std::size_t index) {
    if (is_tfdb_error(error)) {
        nb::setattr(error.value(), "index", nb::int_(index));
    }
}

void set_current_exception() noexcept {
    try {
        throw;
    } catch (nb::python_error& error) {
        error.restore();
    } catch (const Error& error) {
        set_error(error);
    } catch (const nb::builtin_exception& error) {
        PyObject* type = error.type() == nb::exception_type::type_error    ? PyExc_TypeError
                         : error.type() == nb::exception_type::value_error ? PyExc_ValueError
                                                                           : PyExc_RuntimeError;
        PyErr_SetString(type, error.what());
    } catch (const std::bad_alloc&) {
        PyErr_NoMemory();
    } catch (const std::exception& error) {
        PyErr_SetString(PyExc_RuntimeError, error.what());
    }
}

std::string short_repr(nb::handle object) {
    constexpr std::size_t kLongest = 80;
    const nb::object printed = nb::steal(PyObject_Repr(object.ptr()));
    if (!printed.is_valid()) {
        forget_error();
        return "<" + type_name_of(object) + ">";
    }
    std::string result = text_of(printed);
    if (result.size() > kLongest) {
        std::size_t end = kLongest;  // start of a character
        while (end > 0 && (static_cast<unsigned char>(result[end]) & 0xC0U) == 0x80U) {
            --end;
        }
        result.resize(end);
        result += "...";
    }
    return result;
}

std::string type_name_of(nb::handle object) {
#ifndef Py_LIMITED_API
    return Py_TYPE(object.ptr())->tp_name;
#else
    // The same text: the name of a C type includes its module.
    const nb::handle type = object.type();
    const auto name = nb::cast<std::string>(type.attr("__name__"));
    if ((PyType_GetFlags(Py_TYPE(object.ptr())) & Py_TPFLAGS_HEAPTYPE) != 0) {
        return name;
    }
    const auto module = nb::cast<std::string>(type.attr("__module__"));
    return module == "builtins" ? name : module + "." + name;
#endif
}

std::string text_of(nb::handle object) {
    const nb::object text = nb::steal(PyObject_Str(object.ptr()));
    if (!text.is_valid()) {
        forget_error();
        return "<" + type_name_of(object) + ">";
    }
    const nb::object bytes =
        nb::steal(PyUnicode_AsEncodedString(text.ptr(), "utf-8", "backslashreplace"));
    if (!bytes.is_valid()) {
        throw nb::python_error();
    }
    return {PyBytes_AsString(bytes.ptr()), static_cast<std::size_t>(PyBytes_Size(bytes.ptr()))};
}

std::string transform_name(nb::handle target, nb::handle source) {
    return store::transform_name(text_of(target), text_of(source));
}

void forget_error() {
    if (PyErr_Occurred() != nullptr && (PyErr_ExceptionMatches(PyExc_Exception) == 0 ||
                                        PyErr_ExceptionMatches(PyExc_MemoryError) != 0)) {
        throw nb::python_error();
    }
    PyErr_Clear();
}

}  // namespace tfdb::python
