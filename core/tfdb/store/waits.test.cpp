// Waits: each ends exactly once, by its event, timeout, cancellation or the end of the store.
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <functional>
#include <map>
#include <random>
#include <thread>

#include "tfdb/base/interruption.hpp"
#include "tfdb/store/transaction_fixture.test.hpp"
#include "tfdb/testing/sanitized.hpp"

namespace tfdb {
namespace {

using namespace fixture;

constexpr std::int64_t kLong = 60 * kSecond;

/// True, for the test to end there, in engines that keep no feed.
bool skipped() {
    return skipped_in({Concurrency::kGiant, Concurrency::kFine, Concurrency::kNoWait,
                       Concurrency::kWaitDie, Concurrency::kWoundWait, Concurrency::kSilo},
                      "waits are not supported there");
}

void put(Buffer& buffer, std::string_view parent, std::string_view child, StampNs stamp,
         double number) {
    set(buffer, parent, child, stamp, pose_of(number));
}
Question at(std::string_view target, std::string_view source, std::optional<StampNs> stamp) {
    return store::at_stamp(target, source, stamp, {});
}
bool has(const Buffer& buffer, Question question) {
    return store::can_answer(buffer, question);
}

/// A waiting thread. Threads: one makes, joins and reads it. Guarantee: `came` joins.
class Waiter {
public:
    explicit Waiter(std::function<bool()> wait)
        : thread_([this, wait = std::move(wait)] {
              try {
                  came_ = wait();
              } catch (const Error& error) {
                  code_ = error.code();
              }
          }) {}
    ~Waiter() { join(); }
    Waiter(const Waiter&) = delete;
    Waiter& operator=(const Waiter&) = delete;

    bool came() {
        join();
        return came_;
    }
    std::optional<ErrorCode> code() {
        join();
        return code_;
    }

private:
    void join() {
        if (thread_.joinable())
            thread_.join();
    }
    bool came_ = false;
    std::optional<ErrorCode> code_;
    std::thread thread_;
};

/// Waits for the lookup's result, beside a call of `mend` at any time.
void check_mended(Buffer& buffer, const Question& question, const std::function<void()>& mend) {
    CHECK(!has(buffer, question));
    Waiter waiter([&] { return buffer.wait_for(question, kLong); });
    mend();
    CHECK(waiter.came());
    CHECK(has(buffer, question));
}

}  // namespace

TFDB_TEST(a_wait_is_ended_by_whatever_gives_it_its_answer) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    check_mended(buffer, at("map", "camera", std::nullopt),
                 [&] { put(buffer, "map", "camera", 10, 1.0); });
    // A result that already exists ends the wait at once.
    CHECK(buffer.wait_for(at("map", "camera", std::nullopt), std::nullopt));
    check_mended(buffer, at("map", "camera", 20), [&] { put(buffer, "map", "camera", 30, 2.0); });
    check_mended(buffer, at("map", "camera", 5), [&] { put(buffer, "map", "camera", 5, 3.0); });
    put(buffer, "world", "odom", 10, 1.0);
    check_mended(buffer, at("world", "camera", 10), [&] {
        put(buffer, "elsewhere", "thing", 10, 1.0);  // one that has nothing to do with it
        put(buffer, "world", "map", 10, 2.0);
        put(buffer, "world", "map", 40, 2.0);
    });
    const Question close_by = store::at_stamp("map", "camera", 20, {.limit = 5});
    check_mended(buffer, close_by, [&] {
        put(buffer, "map", "camera", 19, 2.0);
        put(buffer, "map", "camera", 22, 2.0);
    });
    buffer.remove_frame("camera", false);
    check_mended(buffer, at("world", "camera", 40),
                 [&] { put(buffer, "world", "camera", 40, 4.0); });
}

TFDB_TEST(a_wait_for_a_commit_ends_with_the_next_one) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    CHECK(!buffer.wait_for_commit(0, 0));
    CHECK(!buffer.wait_for_commit(0, 1'000'000));
    {
        Waiter waiter([&] { return buffer.wait_for_commit(0, kLong); });
        Waiter later([&] { return buffer.wait_for_commit(1, kLong); });
        put(buffer, "map", "a", 1, 1.0);
        CHECK(waiter.came());
        put(buffer, "map", "a", 2, 1.0);
        CHECK(later.came());
    }
    CHECK(buffer.wait_for_commit(1, 0));
    CHECK(!buffer.wait_for_commit(2, 0));
}

TFDB_TEST(a_wait_whose_time_is_over_hands_the_lead_on) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    std::vector<std::unique_ptr<Waiter>> impatient;
    for (int i = 0; i < 8; ++i) {
        impatient.push_back(std::make_unique<Waiter>(
            [&buffer, i] { return buffer.wait_for_commit(0, 1'000'000 * (1 + i % 3)); }));
    }
    Waiter patient([&] { return buffer.wait_for(at("map", "a", 1), kLong); });
    for (const auto& waiter : impatient)
        CHECK(!waiter->came());
    put(buffer, "map", "a", 1, 1.0);
    CHECK(patient.came());
}

TFDB_TEST(closing_ends_all_waits_and_those_to_come) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    std::vector<std::unique_ptr<Waiter>> waiters;
    for (int i = 0; i < 4; ++i) {
        waiters.push_back(std::make_unique<Waiter>(
            [&buffer] { return buffer.wait_for(at("map", "a", 1), std::nullopt); }));
    }
    buffer.end_waits();
    for (const auto& waiter : waiters)
        CHECK(waiter->code() == ErrorCode::kBufferClosed);
    CHECK(THROWN(BufferClosed, (void)buffer.wait_for_commit(0, std::nullopt)));
    put(buffer, "map", "a", 1, 1.0);
    CHECK(buffer.wait_for(at("map", "a", 1), std::nullopt));  // it is there
}

TFDB_TEST(who_is_interrupted_waits_no_longer_and_holds_up_nobody) {
    if (skipped())
        return;
    // NOLINTNEXTLINE(cppcoreguidelines-virtual-class-destructor): on the stack only
    struct Ends final : Interruption {
        void ask() override {
            if (buffer != nullptr)
                (void)buffer->wait_for_commit(0, 0);  // what handlers do may wait, too
            throw std::runtime_error("a signal");
        }
        const Buffer* buffer = nullptr;
    };
    Buffer buffer(keeping(std::nullopt));
    Waiter other([&] { return buffer.wait_for(at("map", "a", 1), kLong); });
    std::thread interrupted([&] {
        Ends ends;
        ends.buffer = &buffer;
        Interruption::current() = &ends;
        bool thrown = false;
        try {
            (void)buffer.wait_for(at("map", "a", 2), kLong);
        } catch (const std::runtime_error&) {
            thrown = true;
        }
        Interruption::current() = nullptr;
        CHECK(thrown);
    });
    interrupted.join();
    put(buffer, "map", "a", 1, 1.0);
    CHECK(other.came());
}

TFDB_TEST(waits_that_are_begun_are_told_of_once) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    const std::uint64_t frame = buffer.begin_wait(at("map", "a", std::nullopt));
    const std::uint64_t commit = buffer.begin_wait_for_commit(1);
    const std::uint64_t given_up = buffer.begin_wait_for_commit(0);
    CHECK(frame != 0 && commit != 0 && given_up != 0);
    CHECK(buffer.cancel_wait(given_up));
    CHECK(!buffer.cancel_wait(given_up));
    CHECK(buffer.ended_waits(1'000'000).empty());
    put(buffer, "map", "a", 1, 1.0);
    const auto first = buffer.ended_waits(std::nullopt);
    CHECK_EQ(first.size(), std::size_t{1});
    CHECK(first.front().number == frame && first.front().how == WaitEnd::kCame);
    CHECK_EQ(buffer.begin_wait(at("map", "a", std::nullopt)), std::uint64_t{0});
    CHECK(!buffer.cancel_wait(frame));
    buffer.end_waits();
    const auto last = buffer.ended_waits(std::nullopt);
    CHECK_EQ(last.size(), std::size_t{1});
    CHECK(last.front().number == commit && last.front().how == WaitEnd::kClosed);
    CHECK(buffer.ended_waits(std::nullopt).empty());
}

TFDB_TEST(a_writer_takes_the_ends_of_its_own_commit_from_a_thread_that_awaits_them) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    std::atomic<bool> over{false};
    std::thread teller([&] {
        while (!over)
            buffer.await_ended_waits(std::nullopt);
    });
    for (StampNs stamp = 1; stamp <= 200; ++stamp) {
        const std::uint64_t wait = buffer.begin_wait(at("map", "a", stamp));
        put(buffer, "map", "a", stamp, 1.0);
        const auto ended = buffer.ended_waits(0);
        CHECK(ended.size() == 1 && ended[0].number == wait && ended[0].how == WaitEnd::kCame);
    }
    over = true;
    buffer.end_waits();
    teller.join();
}

TFDB_TEST(a_wait_for_a_newer_stamp_ends_where_all_of_the_path_is_as_new) {
    if (skipped())
        return;
    Buffer buffer;
    put(buffer, "map", "base", 5, 1.0);
    put(buffer, "base", "arm", 7, 1.0);
    CHECK(buffer.begin_wait(store::as_new_as("map", "arm", 5)) == 0);
    const std::uint64_t wait = buffer.begin_wait(store::as_new_as("map", "arm", 8));
    // Outside the history: no stamp has a result on both edges.
    put(buffer, "base", "arm", 100 * kSecond, 1.0);
    CHECK(buffer.ended_waits(0).empty());
    put(buffer, "map", "base", 100 * kSecond, 1.0);
    const std::vector<EndedWait> ended = buffer.ended_waits(kLong);
    CHECK(ended.size() == 1 && ended[0].number == wait && ended[0].how == WaitEnd::kCame);
}

TFDB_TEST(waits_are_refused_where_they_would_never_end) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    {
        Transaction transaction(buffer);
        CHECK(THROWN(TransactionActive, (void)buffer.wait_for_commit(0, kLong)));
        CHECK(THROWN(TransactionActive, (void)buffer.begin_wait_for_commit(0)));
        transaction.abort();
    }
    BufferOptions options;
    options.concurrency = Concurrency::kSilo;
    const Buffer silo(options);
    CHECK(THROWN(NotSupported, (void)silo.wait_for_commit(0, kLong)));
}

TFDB_TEST(a_child_of_a_process_that_waits_can_wait) {
    if (skipped())
        return;
    Buffer buffer(keeping(std::nullopt));
    Waiter waiter([&] { return buffer.wait_for(at("map", "a", 1), kLong); });
    const pid_t child = ::fork();
    if (child == 0) {
        const bool refused = !buffer.wait_for_commit(buffer.commit(), 1'000'000);
        const std::uint64_t begun = buffer.begin_wait_for_commit(buffer.commit());
        ::_exit(refused && begun != 0 ? 0 : 1);
    }
    int status = 0;
    CHECK(::waitpid(child, &status, 0) == child);
    CHECK_EQ(status, 0);
    put(buffer, "map", "a", 1, 1.0);
    CHECK(waiter.came());
}

/// Random commits over a few frames. Threads: one. Guarantee: the same seed does the same.
class Commits {
public:
    explicit Commits(Buffer& buffer, unsigned seed) : buffer_(buffer), engine_(seed) {}

    void commit() {
        const unsigned child = 1 + random(kFrames - 1);
        now += 2;
        try {
            switch (random(24)) {
                case 0:
                    buffer_.remove_frame(name(child), random(2) == 0);
                    break;
                case 1:
                    buffer_.clear();
                    break;
                case 2:
                    write(name(random(child)), name(child), now - 30, false);
                    break;
                case 3:
                    write(name(random(child)), name(child), 0, true);
                    break;
                default:
                    write(random(8) == 0 ? name(random(child)) : name((child - 1) / 2), name(child),
                          now, false);
            }
        } catch (const Error&) {
            testing::count_check();  // refused: nothing was changed
        }
    }
    /// A lookup of any two frames, at a stamp that may still arrive.
    Question question() {
        static const Policy policies[] = {{},
                                          {.limit = 5},
                                          {.kind = lookup::PolicyKind::kPrevious},
                                          {.kind = lookup::PolicyKind::kExact}};
        std::optional<StampNs> stamp = now + random(60) - 20;
        if (random(6) == 0)
            stamp = std::nullopt;
        const Policy& policy = policies[random(4)];
        const std::string_view target = name(random(kFrames));
        const std::string_view source = name(random(kFrames));
        if (random(6) == 0)
            return store::by_way_of(name(random(kFrames)), target, stamp, source, now, policy);
        return store::at_stamp(target, source, stamp, policy);
    }
    StampNs now = 1000;

private:
    static constexpr unsigned kFrames = 7;

    static std::string_view name(unsigned i) { return std::string_view("abcdefg").substr(i, 1); }
    unsigned random(unsigned below) { return static_cast<unsigned>(engine_()) % below; }
    void write(std::string_view parent, std::string_view child, StampNs stamp, bool is_static) {
        const TransformView view{parent, child, stamp, pose_of(1.0)};
        buffer_.set_transforms({&view, 1}, is_static, "", {.change_kind = true});
    }

    Buffer& buffer_;
    std::minstd_rand engine_;
};

/// After each commit, exactly the waits with a result have been reported.
TFDB_TEST(the_waits_that_end_are_those_that_have_an_answer) {
    if (skipped())
        return;
    constexpr int kCommits = testing::rounds(1000);
    long told = 0;
    for (unsigned seed = 1; seed <= 4; ++seed) {
        Buffer buffer(keeping(400));
        Commits commits(buffer, seed);
        std::map<std::uint64_t, Question> waits;
        for (int i = 0; i < kCommits; ++i) {
            for (int k = 0; k < 3; ++k) {
                const Question question = commits.question();
                const std::uint64_t number = buffer.begin_wait(question);
                CHECK_EQ(number == 0, has(buffer, question));
                if (number != 0)
                    waits.emplace(number, question);
            }
            commits.commit();
            // Sometimes several commits are checked together.
            if (i % 5 < 2)
                continue;
            for (const EndedWait& ended : buffer.ended_waits(0)) {
                ++told;
                waits.erase(ended.number);
            }
            for (const auto& [number, question] : waits) {
                if (has(buffer, question)) {
                    testing::report_failure(__FILE__, __LINE__, "a wait with an answer goes on");
                    return;
                }
            }
            while (waits.size() > 100) {
                CHECK(buffer.cancel_wait(waits.begin()->first));
                waits.erase(waits.begin());
            }
        }
    }
    CHECK(told > testing::rounds(100));
}

/// Threads wait, with or without a timeout, beside one writer. In the end no remaining wait has a
/// result.
TFDB_TEST(no_wait_is_forgotten_beside_a_writer) {
    if (skipped())
        return;
    constexpr int kThreads = 4;
    constexpr int kCommits = 100'000;
    constexpr long kEnough = 5000;  // answers
    Buffer buffer(keeping(400));
    std::atomic<int> left{0};
    std::atomic<long> came{0};
    std::atomic<StampNs> now{1000};
    std::vector<std::thread> threads;
    for (unsigned t = 0; t < kThreads; ++t) {
        threads.emplace_back([&, t] {
            Commits questions(buffer, t + 1);
            for (int i = 0;; ++i) {
                questions.now = now.load();
                const Question question = questions.question();
                try {
                    const auto most = i % 8 == 0 ? std::optional<std::int64_t>()
                                                 : std::optional<std::int64_t>(i % 200 * 1000);
                    came += buffer.wait_for(question, most) ? 1 : 0;
                } catch (const BufferClosed&) {
                    // The closing thread has checked before.
                    left += has(buffer, question) ? 1 : 0;
                    return;
                }
            }
        });
    }
    Commits commits(buffer, 7);
    for (int i = 0; i < kCommits && came.load() < kEnough; ++i) {
        commits.commit();
        now = commits.now;
    }
    buffer.end_waits();
    for (std::thread& thread : threads)
        thread.join();
    CHECK_EQ(left.load(), 0);
    CHECK(came.load() > 0);
}

/// Many threads begin, cancel, block in and close waits. The store ends without open waits.
TFDB_TEST(thousands_of_waits_begin_and_end) {
    if (skipped())
        return;
    constexpr int kRounds = 10;
    constexpr int kEach = 100;
    for (int round = 0; round < kRounds; ++round) {
        Buffer buffer(keeping(400));
        std::atomic<long> told{0};
        std::atomic<long> begun{0};
        std::atomic<long> cancelled{0};
        std::thread teller([&] {
            for (;;) {
                const auto ended = buffer.ended_waits(std::nullopt);
                if (ended.empty())
                    return;
                told += static_cast<long>(ended.size());
            }
        });
        std::vector<std::thread> threads;
        for (unsigned t = 0; t < 4; ++t) {
            threads.emplace_back([&, t] {
                std::minstd_rand random(t + 1);
                for (int i = 0; i < kEach; ++i) {
                    const CommitNumber next = buffer.commit() + random() % 3;
                    if (const std::uint64_t number = buffer.begin_wait_for_commit(next)) {
                        ++begun;
                        if (random() % 2 == 0)
                            cancelled += buffer.cancel_wait(number) ? 1 : 0;
                    }
                    (void)buffer.wait_for_commit(next, random() % 50'000);
                    put(buffer, "map", "a", buffer.commit() + 1, 1.0);
                }
            });
        }
        for (std::thread& thread : threads)
            thread.join();
        buffer.end_waits();
        teller.join();
        CHECK_EQ(told.load() + cancelled.load(), begun.load());
    }
}

TFDB_TEST(stopped_waits_end_as_by_their_time_until_they_may_begin_again) {
    Buffer buffer;
    const Question question = store::at_stamp("map", "a", std::nullopt, {});
    std::thread waiting([&] { CHECK(!buffer.wait_for(question, std::nullopt)); });
    const std::uint64_t begun = buffer.begin_wait(question);
    buffer.stop_waits(true);
    waiting.join();
    const std::vector<EndedWait> ended = buffer.ended_waits(std::nullopt);
    CHECK_EQ(ended.size(), 1U);
    CHECK_EQ(ended[0].number, begun);
    CHECK(ended[0].how == WaitEnd::kStopped);
    CHECK(!buffer.wait_for(question, std::nullopt));
    CHECK(!buffer.wait_for_commit(0, std::nullopt));
    buffer.stop_waits(false);
    std::thread again([&] { CHECK(buffer.wait_for(question, std::nullopt)); });
    put(buffer, "map", "a", 1, 1.0);
    again.join();
    buffer.end_waits();
    buffer.stop_waits(true);
    buffer.stop_waits(false);
    CHECK_THROWS_AS(buffer.wait_for_commit(9, std::nullopt), BufferClosed);
}

TFDB_TEST(a_name_that_no_frame_can_have_is_not_waited_for) {
    const Buffer buffer;
    for (const std::string& name : {std::string(), std::string("a\0b", 3)}) {
        const auto at = [&] { return store::at_stamp("map", name, std::nullopt, {}); };
        CHECK_THROWS_AS(buffer.wait_for(at(), std::nullopt), InvalidName);
        CHECK_THROWS_AS(buffer.begin_wait(at()), InvalidName);
        const Question full = store::by_way_of(name, "map", 1, "a", 1, {});
        CHECK_THROWS_AS(buffer.wait_for(full, 0), InvalidName);
    }
}

}  // namespace tfdb
