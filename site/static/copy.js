// A button beside each snippet that copies it. Pages that are read from files have no clipboard of
// the newer kind in some browsers; the older way works there.
const copied = async (text) => {
    try {
        await navigator.clipboard.writeText(text);
    } catch {
        const area = document.createElement("textarea");
        area.value = text;
        document.body.append(area);
        area.select();
        document.execCommand("copy");
        area.remove();
    }
};

document.addEventListener("DOMContentLoaded", () => {
    for (const block of document.querySelectorAll(".content .highlight")) {
        const code = block.querySelector("pre");
        if (!code) continue;
        const button = document.createElement("button");
        button.type = "button";
        button.className = "copy";
        button.textContent = "copy";
        button.setAttribute("aria-label", "Copy this snippet");
        button.addEventListener("click", async () => {
            await copied(code.textContent);
            button.textContent = "copied";
            setTimeout(() => { button.textContent = "copy"; }, 1500);
        });
        block.append(button);
    }
});
