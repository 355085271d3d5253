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
// Where a subject begins. A page that only mentions the word often does not help its reader.
const SUBJECTS = [
    [/\b(barostats?|npt|pressure|density)\b/, ["docs/cookbook/molecules", "docs/guide/openmm"]],
    [/\b(checkpoints?|restart|resum\w*|save|saving|states?)\b/, ["docs/guide/saving", "docs/cookbook/running"]],
    [/\bviscosit\w+/, ["docs/cookbook/suspensions", "docs/guide/shear"]],
    [/\b(finite.?size|diffusion|msd)\b/, ["docs/cookbook/suspensions", "docs/guide/files_and_analysis"]],
    [/\b(water|tip4p\w*|tip3p\w*)\b/, ["docs/guide/first_steps", "docs/guide/bodies"]],
    [/\b(gpu|cuda|opencl|hip)\b/, ["docs/guide/devices", "docs/gpu"]],
    [/\b(units?|micromet\w+|piconewtons?)\b/, ["docs/cookbook/running", "docs/guide/errors"]],
    [/\b(fast\w*|slow|speed|performance|threads?)\b/, ["docs/guide/performance", "docs/how_cost_grows"]],
    [/\b(install\w*|pip|conda|wheel|packages?)\b/, ["docs/INSTALL"]],
    [/\b(walls?|slit|channel)\b/, ["docs/guide/walls", "docs/cookbook/walls"]],
    [/\b(time)?\s?steps?( size)?\b/, ["docs/cookbook/molecules", "docs/accuracy"]],
    [/\b(polymers?|chains?|beads?|tweezers|traps?)\b/, ["docs/cookbook/polymers", "docs/guide/joints"]],
    [/\b(swimm\w+|squirm\w+|active)\b/, ["docs/guide/swimmers", "docs/cookbook/walls"]],
    [/\blubricat\w+/, ["docs/guide/lubrication"]],
    [/\b(protein|pdb|residues?)\b/, ["docs/cookbook/molecules", "docs/guide/bodies"]],
];
const asked = () => (new URLSearchParams(window.location.search).get("q") || "").toLowerCase();
const isWhereItBegins = (page) => SUBJECTS.some(
    ([words, pages]) => pages.includes(page) && words.test(asked()));
const kindOf = (page) => KINDS.find(([pattern]) => pattern.test(page));

var Scorer = {
    score: ([page, title, anchor, description, score]) => {
        const [, , factor, bonus] = kindOf(page);
        return factor * score + bonus + (isWhereItBegins(page) ? 100 : 0);
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
