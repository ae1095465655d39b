"use strict";
// What a still page lacks: looks by choice, tables in another order, pictures as large as the window. The page says all
// that it has to say without this.
(() => {
  const made = (name, words, more = {}) => Object.assign(document.createElement(name), { textContent: words }, more);

  // Looks: as the system has them, also when it changes, until others are chosen.
  const dark = matchMedia("(prefers-color-scheme: dark)"), choices = ["system", "light", "dark"];
  let choice = 0;
  const dress = () => {
    document.documentElement.dataset.theme = choice === 0 ? (dark.matches ? "dark" : "light") : choices[choice];
  };
  dress();
  dark.addEventListener("change", dress);

  const themeSwitch = () => {
    const button = made("button", "", { type: "button", id: "theme" });
    const tell = () => { button.textContent = `Theme: ${choices[choice]}`; };
    button.addEventListener("click", () => { choice = (choice + 1) % choices.length; dress(); tell(); });
    tell();
    document.querySelector("nav").append(button);
  };

  // Tables: a click on a head sorts by its column, a second one the other way round, a third as it was written.
  const powers = "⁰¹²³⁴⁵⁶⁷⁸⁹⁻";
  const numberOf = words => {
    const plain = words.replace(/[\s\u202f]/g, "").replace(/−/g, "-");
    const found = /^[-+]?\d+(\.\d+)?/.exec(plain);
    if (!found) return NaN;
    const power = /^×10([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)/.exec(plain.slice(found[0].length));
    const exponent = power ? [...power[1]].map(sign => powers.indexOf(sign)).map(n => n === 10 ? "-" : n).join("") : "0";
    return Number(`${found[0]}e${exponent}`);
  };
  const wordsOf = cell => (cell.firstChild ? cell.firstChild.textContent : "").trim();
  const sortable = table => {
    const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0], written = [...body.rows];
    const sort = (column, way) => {
      const keys = new Map(written.map(row => [row, wordsOf(row.cells[column])]));
      const numeric = heads[column].classList.contains("number");
      const order = (a, b) => {
        const [one, other] = [keys.get(a), keys.get(b)];
        if (!numeric) return way * one.localeCompare(other, "en", { numeric: true });
        const [x, y] = [numberOf(one), numberOf(other)];
        // What is undefined stands at the end, whichever way.
        return Number.isNaN(x) || Number.isNaN(y) ? Number.isNaN(x) - Number.isNaN(y) : way * (x - y);
      };
      body.append(...(way === 0 ? written : [...written].sort(order)));
      heads.forEach((head, number) => {
        if (number === column && way !== 0) head.ariaSort = way > 0 ? "ascending" : "descending";
        else head.removeAttribute("aria-sort");
      });
    };
    heads.forEach((head, column) => {
      const next = () => sort(column, { ascending: -1, descending: 0 }[head.ariaSort] ?? 1);
      head.tabIndex = 0;
      head.title = "Sort by this column";
      head.addEventListener("click", next);
      head.addEventListener("keydown", event => {
        if (event.key === "Enter" || event.key === " ") { event.preventDefault(); next(); }
      });
    });
  };

  // Pictures: a click opens one as large as the window, and another one there shows its own pixels.
  const viewer = pictures => {
    const box = made("dialog", "", { id: "viewer" }), large = made("img", ""), words = made("p", "");
    let shown = 0;
    const show = number => {
      shown = (number + pictures.length) % pictures.length;
      const picture = pictures[shown];
      const title = picture.closest("figure").querySelector("h3").textContent;
      large.src = picture.src;
      large.alt = picture.alt;
      words.textContent = `${title} (${shown + 1} of ${pictures.length})`;
      box.classList.remove("whole");
      if (!box.open) box.showModal();
    };
    const act = { ArrowLeft: () => show(shown - 1), ArrowRight: () => show(shown + 1), Home: () => show(0),
                  End: () => show(-1) };
    const bar = made("div", "");
    bar.append(
      made("button", "‹", { type: "button", ariaLabel: "The picture before", onclick: act.ArrowLeft }), words,
      made("button", "›", { type: "button", ariaLabel: "The next picture", onclick: act.ArrowRight }),
      made("button", "Close", { type: "button", onclick: () => box.close() }),
    );
    const room = made("div", "", { className: "room" });
    room.append(large);
    box.append(bar, room);
    large.addEventListener("click", () => box.classList.toggle("whole"));
    room.addEventListener("click", event => { if (event.target === room) box.close(); });
    box.addEventListener("keydown", event => {
      if (!(event.key in act) || event.altKey || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      act[event.key]();
    });
    box.addEventListener("close", () => { pictures[shown].focus(); box.remove(); });
    return { show: number => { document.body.append(box); show(number); } };
  };

  addEventListener("DOMContentLoaded", () => {
    themeSwitch();
    document.querySelectorAll("table").forEach(sortable);
    const pictures = [...document.querySelectorAll("figure img")], { show } = viewer(pictures);
    pictures.forEach((picture, number) => {
      picture.tabIndex = 0;
      picture.setAttribute("role", "button");
      picture.title = "Show it large; arrow keys turn to the others";
      picture.addEventListener("click", () => show(number));
      picture.addEventListener("keydown", event => {
        if (event.key === "Enter" || event.key === " ") { event.preventDefault(); show(number); }
      });
    });
  });
})();
