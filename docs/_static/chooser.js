"use strict";
// Looks the answer up among those stored in the page (docs/_ext/chooser.py computes them); nothing is computed here.
const form = document.getElementById("chooser");
const NAMES = ["class", "accuracy", "span", "keep"];

function element(tag, text, className) {
  const made = document.createElement(tag);
  made.textContent = text;
  if (className) made.className = className;
  return made;
}

function link(address, text) {
  const made = element("a", text);
  made.href = address;
  return made;
}

function name(integrator, own) {
  const id = integrator.split("(")[0];
  return own ? link(`methods/${id}.html`, integrator) : element("span", integrator);
}

function cost(answer) {
  const side = answer.own ? "peer" : "method of this suite";
  if (!answer.rival) return `No ${side} met this accuracy on this scene.`;
  const unlike = answer.alike ? "" : ", which is not declared to keep it";
  return `${answer.ratio} times the time of the best ${side}, ${answer.rival}${unlike}.`;
}

function show(answer, asked) {
  const box = document.getElementById("choice");
  box.replaceChildren();
  if (!answer) {
    box.append(element("p", "No stored run answers this. Ask for your own problem:"));
    box.append(element("pre", `phasebench advise PROBLEM --t-end T --accuracy ${asked.accuracy}${asked.keep ? ` --conserve ${asked.keep}` : ""}`));
    return;
  }
  const head = element("p", "", "chosen");
  head.append(name(answer.integrator, answer.own), document.createTextNode(`, ${answer.size}`));
  box.append(head, element("p", cost(answer)));
  if (answer.span !== asked.span) box.append(element("p", `No scene of this class has such a span; this one is ${answer.span}.`));
  const scene = element("p", "On a stored scene of this kind, ");
  scene.append(answer.scene ? link(`reports/trade-${answer.scene}.html`, answer.scene) : link("reports/options.html", answer.problem));
  scene.append(document.createTextNode(` (${answer.quantity} at t = ${answer.t_end}), its error is ${answer.error} after ${answer.time}.`));
  box.append(scene, element("pre", answer.command));
}

function find(choices, asked) {
  const fits = choices.filter((c) => c.class === asked.class && c.keep === asked.keep && c.accuracy === asked.accuracy);
  return fits.find((c) => c.span === asked.span) || fits[0];
}

if (form) {
  const choices = JSON.parse(document.getElementById("choices").textContent);
  const fields = Object.fromEntries(NAMES.map((key) => [key, document.getElementById(`choose-${key}`)]));
  const update = () => {
    const asked = Object.fromEntries(NAMES.map((key) => [key, fields[key].value]));
    show(find(choices, asked), asked);
  };
  fields.accuracy.value = "1e-06";
  form.hidden = false;
  form.addEventListener("change", update);
  form.addEventListener("submit", (event) => event.preventDefault());
  update();
}
