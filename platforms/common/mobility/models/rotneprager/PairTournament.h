#ifndef RIGIDHI_PAIR_TOURNAMENT_H_
#define RIGIDHI_PAIR_TOURNAMENT_H_

#include <atomic>
#include <memory>
#include <thread>

namespace RigidHIPlugin {

/**
 * All pairs (a, b) of chunks, a <= b, shared by any number of threads such that the contributions
 * of pairs to a chunk are always added in the same order.
 *
 * In round r, chunks with a + b = r modulo the number of chunks meet. Each chunk is in one pair a
 * round (or meets itself), and each pair meets once. Threads take pairs in this order, compute them
 * independently, and add to a chunk when it is the turn of that round. The thread with the earliest
 * unfinished pair never waits. So one thread alone, or threads one after the other, also finish the
 * work.
 */
class PairTournament {
public:
    explicit PairTournament(int numChunks)
        : numChunks(numChunks), turns(new std::atomic<int>[numChunks]) {}
    int getNumPairs() const { return numChunks * (numChunks + 1) / 2; }
    /** Call this before threads call play(). */
    void begin() {
        next = 0;
        for (int a = 0; a < numChunks; a++) turns[a].store(0, std::memory_order_relaxed);
    }
    /**
     * Take pairs until none is left.
     *
     * @param compute  compute(a, b)
     * @param add  add(a, second) adds the results of compute() for chunk a. `second` says whether a
     *     is the second chunk of the pair; otherwise it is the first or only chunk.
     */
    template <class Compute, class Add>
    void play(const Compute& compute, const Add& add) {
        const long long perRound = numChunks / 2 + 1;
        for (;;) {
            const long long place = next.fetch_add(1, std::memory_order_relaxed);
            const int round = static_cast<int>(place / perRound),
                      k = static_cast<int>(place % perRound);
            if (round >= numChunks) return;
            // First the pairs with a + b = round, then those with a + b = round + numChunks. Some
            // rounds have one place too many.
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
