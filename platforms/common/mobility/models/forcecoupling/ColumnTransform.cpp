#include "mobility/models/forcecoupling/ColumnTransform.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace RigidHIPlugin {

namespace {

const int smallRadices[] = {2, 3, 4, 5, 6, 7, 8, 10};

void improve(int rest, std::vector<int>& tried, std::vector<int>& best) {
    const auto cost = [](const std::vector<int>& radices) {
        return std::make_pair(radices.size(), std::accumulate(radices.begin(), radices.end(), 0));
    };
    if (rest == 1) {
        if (best.empty() || cost(tried) < cost(best)) best = tried;
        return;
    }
    for (int radix : smallRadices) {
        if (rest % radix != 0 || (!tried.empty() && radix < tried.back())) continue;
        tried.push_back(radix);
        improve(rest / radix, tried, best);
        tried.pop_back();
    }
}

}  // namespace

std::vector<int> radicesOf(int n) {
    std::vector<int> large, tried, radices;
    int rest = n;
    for (int prime : {2, 3, 5, 7})
        while (rest % prime == 0) rest /= prime;
    const int smooth = n / rest;
    for (int prime = 11; rest > 1; prime += 2)
        for (; rest % prime == 0; rest /= prime) large.push_back(prime);
    if (smooth > 1) improve(smooth, tried, radices);
    radices.insert(radices.end(), large.begin(), large.end());
    return radices;
}

template <typename T>
ColumnTransform<T>::ColumnTransform(int size) : size(size) {
    const auto add = [&](long long numerator, long long denominator) {
        const double angle = 2 * M_PI * (numerator % denominator) / denominator;
        numbers.push_back(std::cos(angle));
        numbers.push_back(-std::sin(angle));
    };
    std::vector<int> radices = radicesOf(size);
    if (radices.empty()) radices = {1};
    int length = size, stride = 1;
    for (int radix : radices) {
        Pass pass = {radix, length, stride, numbers.size(), 0, radix};
        for (int p = 0; p < length / radix; p++)
            for (int j = 1; j < radix; j++) add((long long)p * j, length);
        while (pass.oddFactor % 2 == 0) pass.oddFactor /= 2;
        pass.roots = numbers.size();
        for (int i = 0; i < pass.oddFactor; i++) add(i, pass.oddFactor);
        passes.push_back(pass);
        length /= radix;
        stride *= radix;
    }
}

template ColumnTransform<double>::ColumnTransform(int);
template ColumnTransform<float>::ColumnTransform(int);

}  // namespace RigidHIPlugin
