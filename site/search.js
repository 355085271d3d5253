// What kind of page a result leads to, the factor and the bonus of its score, and a label before each
// result. Readers look for how to do something first, for names second, and for the inside last.
const KINDS = [
    [/^docs\/guide\//, "Guide", 1.5, 20],
    [/^docs\/cookbook\//, "Cookbook", 1.5, 20],
    [/^docs\/schemes\//, "Schemes", 1, 10],
    [/^docs\/models\//, "Models", 1, 10],
    [/^api\//, "Python", 0.7, 5],
    [/^cpp\//, "C++", 0.6, 0],
    [/^examples\//, "Example", 1, 0],
    [/^(CONTRIBUTING|CHANGELOG|SECURITY|docs\/ARCHITECTURE)/, "Development", 0.2, -40],
    [/^docs\/theory\//, "Theory", 0.5, 0],
    [/^validation\//, "Validation", 0.5, -10],
    [/^(benchmarks|packaging|debian|tools)\//, "Benchmarks", 0.5, -10],
    [/^/, "Page", 1, 0],
];
const kindOf = (page) => KINDS.find(([pattern]) => pattern.test(page));

var Scorer = {
    score: ([page, title, anchor, description, score]) => {
        const [, , factor, bonus] = kindOf(page);
        return factor * score + bonus;
    },
    // Who gives the whole name of a method looks for that method.
    objNameMatch: 60,
    // What Sphinx has where it is not told otherwise.
    objPartialMatch: 6,
    objPrio: {0: 15, 1: 5, 2: -5},
    objPrioDefault: 0,
    title: 15,
    partialTitle: 7,
    term: 5,
    partialTerm: 2,
};

document.addEventListener("DOMContentLoaded", () => {
    const results = document.getElementById("search-results");
    if (!results) return;
    const label = () => {
        for (const item of results.querySelectorAll("ul.search > li")) {
            const link = item.querySelector("a");
            if (!link || item.querySelector(".kind")) continue;
            const kind = document.createElement("span");
            kind.className = "kind";
            kind.textContent = kindOf(link.getAttribute("href").replace(/^(\.\.?\/)*/, ""))[1];
            item.prepend(kind);
        }
    };
    new MutationObserver(label).observe(results, {childList: true, subtree: true});
    label();
});
