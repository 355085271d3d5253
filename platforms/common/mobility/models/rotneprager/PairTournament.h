#ifndef RIGIDHI_PAIR_TOURNAMENT_H_
#define RIGIDHI_PAIR_TOURNAMENT_H_

#include <atomic>
#include <memory>
#include <thread>

namespace RigidHIPlugin {

/**
 * All pairs (a, b) of chunks, a <= b, shared by any number of threads so that what pairs give to a
 * chunk is always added in the same order.
 *
 * In round r meet those with a + b = r modulo the number of chunks: each chunk is in one pair a
 * round (or meets itself), and each pair meets once. Threads take pairs in this order, compute them
 * apart, and add to a chunk when it is that round's turn. Whoever holds the first pair of those not
 * yet done never waits, so that one thread alone, or one after the other, gets through, too.
 */
class PairTournament {
public:
    explicit PairTournament(int numChunks)
        : numChunks(numChunks), turns(new std::atomic<int>[numChunks]) {}
    int getNumPairs() const { return numChunks * (numChunks + 1) / 2; }
    /** Before threads come to play(). */
    void begin() {
        next = 0;
        for (int a = 0; a < numChunks; a++) turns[a].store(0, std::memory_order_relaxed);
    }
    /**
     * Take pairs until there are none.
     *
     * @param compute  compute(a, b)
     * @param add      add(a, second): add what compute() found for a, its second chunk or its
     * first, also its only one
     */
    template <class Compute, class Add>
    void play(const Compute& compute, const Add& add) {
        const long long perRound = numChunks / 2 + 1;
        for (;;) {
            const long long place = next.fetch_add(1, std::memory_order_relaxed);
            const int round = static_cast<int>(place / perRound),
                      k = static_cast<int>(place % perRound);
            if (round >= numChunks) return;
            // a + b = round, then a + b = round + numChunks; in some rounds there is a place too
            // many.
            const int a = k <= round / 2 ? k : k + (round + 1) / 2;
            const int b = k <= round / 2 ? round - a : round + numChunks - a;
            if (a > b) continue;
            compute(a, b);
            takeTurn(a, round, [&] { add(a, false); });
            if (a != b) takeTurn(b, round, [&] { add(b, true); });
        }
    }

private:
    template <class Add>
    void takeTurn(int chunk, int round, const Add& add) {
        while (turns[chunk].load(std::memory_order_acquire) != round) std::this_thread::yield();
        add();
        turns[chunk].store(round + 1, std::memory_order_release);
    }

    const int numChunks;
    std::atomic<long long> next;
    std::unique_ptr<std::atomic<int>[]> turns;  // of each chunk: the round whose pair may be added
};

}  // namespace RigidHIPlugin

#endif
