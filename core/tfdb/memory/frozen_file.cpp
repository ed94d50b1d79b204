#include "tfdb/memory/frozen_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <utility>

#include "tfdb/base/interruption.hpp"
#include "tfdb/memory/file.hpp"

namespace tfdb::memory {
namespace {

constexpr std::size_t kHeaderWords = kFrozenHeaderBytes / 8;
constexpr std::size_t kWordsAtOnce = std::size_t{1} << 17;  // words read per call
constexpr std::uint64_t kSeed = 0x54464442;

/// Continues a checksum over more words. Each step is a bijection of sums and of words, so any
/// change of a single word is detected.
std::uint64_t sum_on(std::uint64_t sum, std::span<const std::uint64_t> words) {
    constexpr std::uint64_t kGolden = 0x9E3779B97F4A7C15ULL;
    for (const std::uint64_t word : words) {
        sum = (sum ^ word) * kGolden;
        sum ^= sum >> 32;
    }
    return sum;
}

std::uint64_t sum_of_header(std::vector<std::uint64_t> words) {
    words.resize(kHeaderWords);
    words[kHeaderSumWord] = 0;
    return sum_on(kSeed, words);
}

/// Reads all words. False: the file ends before.
bool read_whole(int file, std::span<std::uint64_t> words, std::size_t at) {
    auto* to = reinterpret_cast<char*>(words.data());
    std::size_t left = words.size_bytes();
    while (left > 0) {
        const ssize_t got = ::pread(file, to, left, static_cast<off_t>(at));
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return false;
        to += got;
        at += static_cast<std::size_t>(got);
        left -= static_cast<std::size_t>(got);
    }
    return true;
}

/// Checksum of everything behind the header. False: the file ends before.
bool sum_of_data(int file, std::size_t bytes, std::uint64_t& sum) {
    sum = kSeed;
    std::vector<std::uint64_t> part(kWordsAtOnce);
    for (std::size_t at = kFrozenHeaderBytes; at < bytes; at += part.size() * 8) {
        interruption_point();
        part.resize(std::min(kWordsAtOnce, (bytes - at) / 8));
        if (!read_whole(file, part, at))
            return false;
        sum = sum_on(sum, part);
    }
    return true;
}

[[noreturn]] void throw_frozen(int error, const std::string& path) {
    const std::string reason = reason_of(error);
    if (error == ENOENT || error == ENOTDIR)
        throw NoSuchStore("no frozen store " + path + ": " + reason +
                              "; Buffer.freeze and `tfdb freeze` write one",
                          detail_of(path, reason));
    if (error == EACCES || error == EPERM)
        throw ReadOnly("the frozen store " + path + " is not readable: " + reason +
                           "; ask its owner for permission",
                       detail_of(path, reason));
    if (error == EISDIR || error == ENAMETOOLONG || error == ELOOP || error == ENXIO)
        throw_corrupt(path, "not a frozen store of tfdb: " + reason);
    throw CapacityExceeded("the frozen store " + path + " cannot be read: " + reason,
                           detail_of(path, reason));
}

void check_header(int file, const std::string& path, std::size_t bytes, std::uint64_t layout,
                  std::vector<std::uint64_t>& header) {
    header.resize(kDataSumWord + 1);
    if (!read_whole(file, header, 0) || header[kMagicWord] != kFrozenMagic) {
        throw_corrupt(path, header[kMagicWord] == kSharedMagic
                                ? "it is a shared store: Buffer.open opens it"
                                : "not a frozen store of tfdb; tfdb.load reads recordings");
    }
    if (header[kLayoutWord] != layout)
        throw_corrupt(path,
                      "it is from another version of tfdb or another kind of machine; freeze "
                      "the recording again");
    if (header[kBytesWord] != bytes || bytes < kFrozenHeaderBytes || bytes % 8 != 0)
        throw_corrupt(path, "it has " + std::to_string(bytes) + " bytes instead of " +
                                std::to_string(header[kBytesWord]) +
                                ": it was cut or extended; freeze the recording again");
    header.resize(kHeaderWords);
    if (!read_whole(file, header, 0) || sum_of_header(header) != header[kHeaderSumWord] ||
        header[kEndWord] != bytes)
        throw_corrupt(path, "its header is damaged; freeze the recording again");
}

}  // namespace

SharedFile open_frozen(const std::string& path, std::uint64_t layout, bool verify) {
    // O_NONBLOCK: opening a pipe must not block.
    File file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    struct stat status {};
    if (file.get() < 0 || ::fstat(file.get(), &status) != 0)
        throw_frozen(errno, path);
    if (!S_ISREG(status.st_mode))
        throw_corrupt(path, "not a regular file");
    const auto bytes = static_cast<std::size_t>(status.st_size);
    std::vector<std::uint64_t> header;
    check_header(file.get(), path, bytes, layout, header);
    std::uint64_t sum = 0;
    if (verify && (!sum_of_data(file.get(), bytes, sum) || sum != header[kDataSumWord]))
        throw_corrupt(path, "it is damaged; freeze the recording again");
    return {.data = Mapping::of_file(file.release(), bytes, false, path, reach_of(bytes)),
            .control = nullptr,
            .path = path,
            .frozen = true};
}

void NewFrozenFile::fail(int error) const {
    const std::string reason = reason_of(error);
    if (error == ENOENT || error == ENOTDIR)
        throw NoSuchStore("no folder for " + path_ + ": " + reason, detail_of(path_, reason));
    if (error == EEXIST)
        throw StoreExists("the file " + path_ + " exists already", detail_of(path_, reason));
    if (error == EACCES || error == EPERM || error == EROFS)
        throw ReadOnly(path_ + " is not writable: " + reason, detail_of(path_, reason));
    throw CapacityExceeded(
        "the frozen store " + path_ + " cannot be written: " + reason +
            "; the partial file was removed: choose another place, or free space",
        detail_of(path_, reason));
}

NewFrozenFile::NewFrozenFile(std::string path, bool in_place) : path_(std::move(path)) {
    for (unsigned number = 0;; ++number) {
        made_ = path_;
        if (!in_place)
            made_ += ".new-" + std::to_string(::getpid()) + "-" + std::to_string(number);
        file_ = ::open(made_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (file_ >= 0)
            return;
        if (errno != EEXIST || in_place)
            fail(errno);
    }
}

NewFrozenFile::~NewFrozenFile() {
    ::close(file_);
    if (!published_)
        ::unlink(made_.c_str());
}

void NewFrozenFile::write(Offset at, std::span<const std::uint64_t> words) {
    const auto* from = reinterpret_cast<const char*>(words.data());
    std::size_t left = words.size_bytes();
    while (left > 0) {
        const ssize_t put = ::pwrite(file_, from, left, static_cast<off_t>(at));
        if (put < 0 && errno == EINTR)
            continue;
        if (put <= 0)
            fail(put < 0 ? errno : ENOSPC);
        from += put;
        at += static_cast<Offset>(put);
        left -= static_cast<std::size_t>(put);
    }
}

void NewFrozenFile::publish(std::vector<std::uint64_t> front, std::size_t bytes,
                            std::uint64_t layout) {
    front.resize(std::max(front.size(), kHeaderWords));
    write(0, front);
    if (::ftruncate(file_, static_cast<off_t>(bytes)) != 0)
        fail(errno);
    front[kMagicWord] = kFrozenMagic;
    front[kBytesWord] = bytes;
    front[kLayoutWord] = layout;
    if (!sum_of_data(file_, bytes, front[kDataSumWord]))
        fail(EIO);
    front[kHeaderSumWord] = sum_of_header(front);
    write(0, std::span(front).first(kHeaderWords));
    // If the file already has its name, this changes nothing.
    if (::fsync(file_) != 0 || ::rename(made_.c_str(), path_.c_str()) != 0)
        fail(errno);
    published_ = true;
    // Syncs the name if the file system supports it.
    const std::size_t slash = path_.rfind('/');
    const std::string folder = slash == std::string::npos ? "." : path_.substr(0, slash + 1);
    if (const File opened(::open(folder.c_str(), O_RDONLY | O_CLOEXEC)); opened.get() >= 0)
        ::fsync(opened.get());
}

}  // namespace tfdb::memory
