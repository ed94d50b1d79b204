#pragma once

// The test harness: register with TFDB_TEST, check with CHECK*. A failed check is printed and
// counted, and the test continues. A test passes if it recorded no failure and no exception
// escaped.

#include <cmath>
#include <exception>
#include <ostream>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace tfdb::testing {

// One registered test.
// Threads: registered before main, read by the runner alone.
// Guarantee: plain data.
struct TestCase {
    const char* name;
    const char* file;
    int line;
    void (*body)();
};

std::vector<TestCase>& registry();

// Records a failure of the running test; any thread of the test may call it.
void report_failure(const char* file, int line, const std::string& message);

// Counts a check; a test without checks is reported as a failure.
void count_check();

struct Registrar {
    Registrar(const char* name, const char* file, int line, void (*body)()) {
        registry().push_back(TestCase{name, file, line, body});
    }
};

template <typename T, typename = void>
struct IsPrintable : std::false_type {};
template <typename T>
struct IsPrintable<T,
                   std::void_t<decltype(std::declval<std::ostream&>() << std::declval<const T&>())>>
    : std::true_type {};

template <typename T>
std::string show(const T& value) {
    std::ostringstream out;
    out.precision(17);
    if constexpr (std::is_enum_v<T>) {
        out << static_cast<long long>(value);
    } else if constexpr (std::is_same_v<T, std::nullptr_t>) {
        out << "nullptr";
    } else if constexpr (IsPrintable<T>::value) {
        out << std::boolalpha << value;
    } else {
        out << "<" << sizeof(T) << " bytes>";
    }
    return out.str();
}

// Compares signed with unsigned by value, as std::cmp_equal does.
template <typename A, typename B>
bool equal(const A& a, const B& b) {
    constexpr bool kIntegers = std::is_integral_v<A> && std::is_integral_v<B> &&
                               !std::is_same_v<A, bool> && !std::is_same_v<B, bool> &&
                               !std::is_same_v<A, char> && !std::is_same_v<B, char>;
    constexpr bool kMixed = std::is_arithmetic_v<A> && std::is_arithmetic_v<B> &&
                            std::is_floating_point_v<A> != std::is_floating_point_v<B>;
    if constexpr (kIntegers) {
        return std::cmp_equal(a, b);
    } else if constexpr (kMixed) {
        return static_cast<double>(a) == static_cast<double>(b);
    } else {
        return a == b;
    }
}

template <typename A, typename B>
void check_equal(const A& a, const B& b, const char* text_a, const char* text_b, const char* file,
                 int line) {
    count_check();
    if (!equal(a, b)) {
        report_failure(file, line,
                       std::string(text_a) + " == " + text_b + "\n      left:  " + show(a) +
                           "\n      right: " + show(b));
    }
}

inline void check_true(bool value, const char* text, const char* file, int line) {
    count_check();
    if (!value) {
        report_failure(file, line, text);
    }
}

// Fails if either side is NaN.
inline void check_near(double a, double b, double tolerance, const char* text, const char* file,
                       int line) {
    count_check();
    if (!(std::fabs(a - b) <= tolerance)) {
        report_failure(file, line,
                       std::string(text) + "\n      left:  " + show(a) + "\n      right: " +
                           show(b) + "\n      apart: " + show(std::fabs(a - b)));
    }
}

template <typename Expected, typename Body>
void check_throws(Body&& body, const char* text, const char* file, int line) {
    count_check();
    try {
        body();
    } catch (const Expected&) {
        return;
    } catch (const std::exception& other) {
        report_failure(file, line, std::string(text) + " threw another type: " + other.what());
        return;
    } catch (...) {
        report_failure(file, line, std::string(text) + " threw another type");
        return;
    }
    report_failure(file, line, std::string(text) + " did not throw");
}

}  // namespace tfdb::testing

#define TFDB_TEST_CONCAT_(a, b) a##b
#define TFDB_TEST_CONCAT(a, b) TFDB_TEST_CONCAT_(a, b)

// `static` lets two files use the same test name.
#define TFDB_TEST(name)                                                              \
    static void TFDB_TEST_CONCAT(tfdb_test_, name)();                                \
    static const ::tfdb::testing::Registrar TFDB_TEST_CONCAT(tfdb_registrar_, name)( \
        #name, __FILE__, __LINE__, &TFDB_TEST_CONCAT(tfdb_test_, name));             \
    static void TFDB_TEST_CONCAT(tfdb_test_, name)()

#define CHECK(...) \
    ::tfdb::testing::check_true(static_cast<bool>(__VA_ARGS__), #__VA_ARGS__, __FILE__, __LINE__)

#define CHECK_EQ(a, b) ::tfdb::testing::check_equal((a), (b), #a, #b, __FILE__, __LINE__)

#define CHECK_NEAR(a, b, tolerance)                                                       \
    ::tfdb::testing::check_near((a), (b), (tolerance), #a " ~ " #b " within " #tolerance, \
                                __FILE__, __LINE__)

#define CHECK_THROWS_AS(expression, Type)                                       \
    ::tfdb::testing::check_throws<Type>([&] { static_cast<void>(expression); }, \
                                        #expression " throws " #Type, __FILE__, __LINE__)
