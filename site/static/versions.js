// A list of the site's versions beside its name, if the site is deployed with several: versions.json
// beside the folder of this version names the folders, for instance ["latest", "0.1.0"]. Without
// this file, and on pages that are read from files, nothing is shown.
(() => {
    const root = new URL("..", document.currentScript.src);
    const current = decodeURIComponent(root.pathname).split("/").at(-2);

    const names = async () => {
        const answer = await fetch(new URL("../versions.json", root));
        const listed = answer.ok ? await answer.json() : [];
        // Names of folders only: a list cannot lead elsewhere.
        const folders = listed.filter((name) => /^\w[\w.-]*$/.test(name));
        return folders.includes(current) ? folders : [current, ...folders];
    };

    // The same page of another version, or its first page.
    const go = async (version) => {
        const first = new URL(`../${version}/`, root);
        const same = new URL(location.href.slice(root.href.length), first);
        const there = await fetch(same, {method: "HEAD"}).then((answer) => answer.ok, () => false);
        location.assign(there ? same : first);
    };

    document.addEventListener("DOMContentLoaded", async () => {
        if (root.protocol === "file:" || !current) return;
        const versions = await names().catch(() => []);
        if (versions.length < 2) return;
        const label = document.createElement("label");
        const select = document.createElement("select");
        label.className = "versions";
        label.append("Version ", select);
        for (const name of versions) select.append(new Option(name, name, false, name === current));
        select.addEventListener("change", () => go(select.value));
        document.querySelector(".sidebar-brand").after(label);
    });
})();
