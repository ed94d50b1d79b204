#include "tfdb/memory/shared_file.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>

#include "tfdb/memory/file.hpp"
#include "tfdb/memory/region.hpp"

namespace tfdb::memory {
namespace {

// Opening a pipe of that name would block.
constexpr int kOpened = O_CLOEXEC | O_NONBLOCK;

[[noreturn]] void throw_for(int error, const std::string& path, bool to_write = false) {
    const std::string reason = reason_of(error);
    if (error == ENOENT || error == ENOTDIR) {
        const bool by_name = named(path) != path;
        throw NoSuchStore("no shared store " + named(path) +
                              (by_name ? "; `tfdb shm ls` lists the existing ones" : ": " + reason),
                          detail_of(path, reason));
    }
    if (error == EEXIST)
        throw StoreExists("the store " + named(path) + " exists already", detail_of(path, reason));
    if (error == EACCES || error == EPERM || error == EROFS) {
        throw ReadOnly("the store " + named(path) + " cannot be opened in this mode: " + reason +
                           (to_write ? "; ask for mode \"r\", or its owner for permission"
                                     : "; ask its owner for permission"),
                       detail_of(path, reason));
    }
    if (error == EISDIR || error == ENAMETOOLONG || error == ELOOP)
        throw_corrupt(path, "not a store of tfdb: " + reason);
    throw CapacityExceeded("the store " + named(path) + " cannot be opened: " + reason,
                           detail_of(path, reason));
}

// Suffix of the control file's name.
constexpr const char* kUnpublished = ".new";
constexpr const char* kRemoved = ".old";

std::string control_name(const std::string& path, std::uint64_t id) {
    std::array<char, 17> text{};
    std::snprintf(text.data(), text.size(), "%016llx", static_cast<unsigned long long>(id));
    return path + ".control-" + text.data();
}

std::uint64_t random_id() {
    std::uint64_t id = 0;
    // glibc provides getrandom from 2.25 on
    while (::syscall(SYS_getrandom, &id, sizeof id, 0) != sizeof id) {
    }
    return id;
}

struct Header {
    std::array<std::uint64_t, kLayoutWord + 1> words{};
    std::size_t bytes = 0;  // size of the file
};

/// Reads the header; finds out whether the file is a store's at all.
Header header_of(int file, const std::string& path) {
    Header header;
    struct stat status {};
    if (::fstat(file, &status) != 0)
        throw_for(errno, path);
    header.bytes = static_cast<std::size_t>(status.st_size);
    if (!S_ISREG(status.st_mode) ||
        ::pread(file, header.words.data(), sizeof header.words, 0) != sizeof header.words)
        throw_corrupt(path, "not a store of tfdb");
    if (header.words[kMagicWord] == kFrozenMagic)
        throw_corrupt(path, "it is a frozen store: tfdb.open opens it read-only");
    if (header.words[kMagicWord] != kSharedMagic)
        throw_corrupt(path, "not a store of tfdb");
    return header;
}

/// Locks a control file as its creator does, for as long as the file is open. False: another
/// process holds the lock.
bool lock_as_maker(int control) {
    struct flock lock {};
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    lock.l_start = Control::kSlots;
    lock.l_len = 1;
    return ::fcntl(control, F_OFD_SETLK, &lock) == 0;
}

/// Id of the store with this name; 0 if it is missing.
std::uint64_t id_at(const std::string& path) {
    const File file(::open(path.c_str(), O_RDONLY | kOpened));
    std::array<std::uint64_t, kIdWord + 1> words{};
    if (file.get() < 0 || ::pread(file.get(), words.data(), sizeof words, 0) != sizeof words)
        return 0;
    return words[kIdWord];
}

/// The id after `.control-` in a control file's name; 0: not a control file.
std::uint64_t id_in(std::string_view digits) {
    std::uint64_t id = 0;
    const char* const end = digits.data() + digits.size();
    const auto [last, error] = std::from_chars(digits.data(), end, id, 16);
    return digits.size() == 16 && error == std::errc{} && last == end ? id : 0;
}

/// Removes files whose creator was killed before it published this store.
void remove_left_over(const std::string& path) {
    const std::size_t slash = path.rfind('/');
    const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash + 1);
    const std::string begin = path.substr(slash + 1) + ".control-";
    const std::unique_ptr<DIR, int (*)(DIR*)> entries(::opendir(folder.c_str()), ::closedir);
    if (entries == nullptr)
        return;
    while (const dirent* const entry = ::readdir(entries.get())) {
        const std::string_view name = entry->d_name;
        const std::uint64_t id =
            name.substr(0, begin.size()) == begin ? id_in(name.substr(begin.size())) : 0;
        if (id == 0)
            continue;
        const std::string control = control_name(path, id);
        const File file(::open(control.c_str(), O_RDWR | kOpened));
        // Its creator has ended, so the file is stable: only now is it certain whether it was
        // published.
        if (file.get() < 0 || !lock_as_maker(file.get()))
            continue;
        ::unlink((control + kUnpublished).c_str());
        ::unlink((control + kRemoved).c_str());
        if (id_at(path) != id)
            ::unlink(control.c_str());
    }
}

bool is_link(const std::string& path) {
    struct stat status {};
    return ::lstat(path.c_str(), &status) == 0 && S_ISLNK(status.st_mode);
}

/// Whether the file still has a name.
bool is_linked(int file) {
    struct stat status {};
    return ::fstat(file, &status) == 0 && status.st_nlink > 0;
}

}  // namespace

SharedFile open_shared(const std::string& given, bool writable, std::uint64_t layout) {
    // The control file lies beside the data file itself, even if the path leads through links.
    const std::unique_ptr<char, void (*)(void*)> real(::realpath(given.c_str(), nullptr), ::free);
    const std::string path = real == nullptr ? given : real.get();
    File file(::open(path.c_str(), (writable ? O_RDWR : O_RDONLY) | kOpened));
    if (file.get() < 0) {
        const int error = errno;
        if (error == ENOENT) {
            if (is_link(path))
                throw_corrupt(path, "it is a dangling link; remove it");
            remove_left_over(path);
        }
        throw_for(error, path, writable);
    }
    const Header header = header_of(file.get(), path);
    if (header.words[kLayoutWord] != layout)
        throw_corrupt(path,
                      "it is from another version of tfdb or another kind of machine; "
                      "use that version, or remove it (`tfdb shm rm`) and create it again");
    if (header.words[kBytesWord] != header.bytes)
        throw_corrupt(path, "it has " + std::to_string(header.bytes) + " bytes instead of " +
                                std::to_string(header.words[kBytesWord]) +
                                ": it was cut or extended; remove it and create it again");
    const std::uint64_t id = header.words[kIdWord];
    const std::string control = control_name(path, id);
    std::unique_ptr<Control> shared;
    const int opened = ::open(control.c_str(), O_RDWR | kOpened);
    if (opened >= 0)
        shared = std::make_unique<Control>(opened, id, path);
    else if (errno == ENOENT && is_linked(file.get()))
        throw_corrupt(path, "its control file is missing; remove it and create it again");
    else if (writable || (errno != EACCES && errno != EROFS))
        throw_for(errno, path, writable);
    return {.data = Mapping::of_file(file.release(), header.bytes, writable, named(path),
                                     reach_of(header.bytes)),
            .control = std::move(shared),
            .path = path,
            .writable = writable};
}

int NewSharedFile::open_new(const std::string& name, std::size_t bytes) const {
    File file(::open(name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
    if (file.get() < 0) {
        const std::string reason = reason_of(errno);
        if (errno == ENOENT || errno == ENOTDIR)
            throw NoSuchStore("the store " + named(path_) + " cannot be created: " + reason +
                                  "; create its folder first",
                              detail_of(path_, reason));
        throw_for(errno, path_);
    }
    const bool done =
        (group_ < 0 ||
         ::fchown(file.get(), static_cast<uid_t>(-1), static_cast<gid_t>(group_)) == 0) &&
        ::fchmod(file.get(), mode_) == 0 && ::ftruncate(file.get(), static_cast<off_t>(bytes)) == 0;
    if (!done) {
        const int error = errno;
        ::unlink(name.c_str());
        throw_for(error, path_);
    }
    return file.release();
}

NewSharedFile::NewSharedFile(std::string path, std::size_t bytes, unsigned mode, std::int64_t group)
    : path_(std::move(path)), bytes_(bytes), mode_(mode), group_(group) {
    if (::access(path_.c_str(), F_OK) == 0)
        throw_for(EEXIST, path_);
    remove_left_over(path_);
    while (!begin()) {
    }
    try {
        const int control = ::fcntl(made_, F_DUPFD_CLOEXEC, 0);
        if (control < 0)
            throw_for(errno, control_);
        Control::prepare(Mapping::of_file(control, Control::kBytes, true, control_), id_);
        const int data = open_new(data_, bytes_);
        ::close(data);
    } catch (...) {
        ::unlink(control_.c_str());
        ::close(made_);
        throw;
    }
}

/// Creates the control file. False: another process removed it as a leftover before it was locked.
bool NewSharedFile::begin() {
    id_ = random_id();
    control_ = control_name(path_, id_);
    data_ = control_ + kUnpublished;
    made_ = open_new(control_, Control::kBytes);
    if (lock_as_maker(made_) && is_linked(made_))
        return true;
    ::unlink(control_.c_str());
    ::close(made_);
    return false;
}

Mapping NewSharedFile::map() const {
    File file(::open(data_.c_str(), O_RDWR | O_CLOEXEC));
    if (file.get() < 0)
        throw_for(errno, path_);
    Mapping mapping = Mapping::of_file(file.release(), bytes_, true, named(path_));
    mapping.back(0, mapping.step());
    return mapping;
}

void NewSharedFile::publish(std::uint64_t layout) {
    File file(::open(data_.c_str(), O_RDWR | O_CLOEXEC));
    if (file.get() < 0)
        throw_for(errno, path_);
    const auto write = [&](off_t word, std::uint64_t value) {
        if (::pwrite(file.get(), &value, sizeof value, 8 * word) != sizeof value)
            throw_for(errno, path_);
    };
    write(kIdWord, id_);
    write(kBytesWord, bytes_);
    write(kLayoutWord, layout);
    write(kMagicWord, kSharedMagic);
    if (::link(data_.c_str(), path_.c_str()) != 0)
        throw_for(errno, path_);
    ::unlink(data_.c_str());
    published_ = true;
}

NewSharedFile::~NewSharedFile() {
    if (!published_) {
        ::unlink(data_.c_str());
        ::unlink(control_.c_str());
    }
    ::close(made_);
}

void unlink_shared(const std::string& path) {
    remove_left_over(path);
    const auto id_of = [&](int file) { return header_of(file, path).words[kIdWord]; };
    const File file(::open(path.c_str(), O_RDONLY | kOpened));
    if (file.get() < 0)
        throw_for(errno, path);
    std::uint64_t id = id_of(file.get());
    // Another process may now remove the store and create a new one, so the file that loses its
    // name is verified.
    const std::string taken = control_name(path, id) + kRemoved;
    if (::rename(path.c_str(), taken.c_str()) != 0)
        throw_for(errno, path);
    const File found(::open(taken.c_str(), O_RDONLY | kOpened));
    if (found.get() >= 0)
        id = id_of(found.get());
    const std::string control = control_name(path, id);
    // Without write permission the store is still removed, but waits are not woken.
    std::optional<Mapping> control_mapping;
    struct stat status {};
    File opened(::open(control.c_str(), O_RDWR | kOpened));
    if (opened.get() >= 0 && ::fstat(opened.get(), &status) == 0 &&
        static_cast<std::size_t>(status.st_size) >= Control::kBytes)
        control_mapping.emplace(Mapping::of_file(opened.release(), Control::kBytes, true, control));
    ::unlink(taken.c_str());
    ::unlink(control.c_str());
    if (control_mapping && Control::is_of(*control_mapping, id))
        Control::notify_removal(*control_mapping);
}

}  // namespace tfdb::memory
