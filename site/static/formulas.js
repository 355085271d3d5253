// Sphinx loads this only where a page has formulas; KaTeX lies beside it.
const place = document.currentScript.src.replace(/[^/]*$/, "katex/");
const load = (name) => new Promise((done) => {
    const script = document.createElement("script");
    script.src = place + name;
    script.onload = done;
    document.head.append(script);
});

document.addEventListener("DOMContentLoaded", async () => {
    await load("katex.js");
    await load("auto-render.js");
    for (const each of document.querySelectorAll(".math"))
        renderMathInElement(each, {delimiters: [{left: "\\(", right: "\\)", display: false}, {left: "\\[", right: "\\]", display: true}]});
});
