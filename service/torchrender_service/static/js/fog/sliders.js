// What the air is like, and what is shown of it.

const $ = (id) => document.getElementById(id);
const VISIBILITY = { true: [1, 300], false: [10, 5000] }; // metres, indoors or not
const GAIN = [0.1, 10];
const ABSORBED = 0.9; // largest share of the extinction that absorbs
const CONTRAST = 3.912;
const onScale = ([low, high], share) => low * (high / low) ** share;

export class Sliders {
  /** `changed()` is called while any of them moves. */
  constructor(changed) {
    this.indoors = true;
    for (const name of ["visibility", "absorption", "asymmetry", "light-gain", "shaft-gain", "top"])
      $(name).addEventListener("input", () => {
        this.show();
        changed();
      });
    for (const name of ["transmittance", "loss", "show"]) $(name).addEventListener("change", changed);
    this.show();
  }

  setIndoors(indoors) {
    this.indoors = indoors;
    for (const element of document.querySelectorAll("[data-only]")) element.hidden = (element.dataset.only === "indoors") !== indoors;
    this.show();
  }

  /** The medium and how it is computed, as fields of POST /v1/fog. */
  get values() {
    const share = (name) => Number($(name).value) / 100;
    const visibility = Number(onScale(VISIBILITY[this.indoors], share("visibility")).toPrecision(3));
    const values = {
      visibility,
      absorption: Number(((CONTRAST / visibility) * ABSORBED * share("absorption")).toPrecision(4)),
      asymmetry: share("asymmetry"),
      show: $("show").value,
    };
    if (this.indoors) {
      values.light_gain = Number(onScale(GAIN, share("light-gain")).toPrecision(3));
      values.shaft_gain = Number(onScale(GAIN, share("shaft-gain")).toPrecision(3));
      values.transmittance = $("transmittance").value;
    } else {
      values.top = Number(onScale([2, 2000], share("top")).toPrecision(3));
      values.loss = $("loss").value;
    }
    return values;
  }

  show() {
    const { visibility, asymmetry, light_gain, shaft_gain, top } = this.values;
    $("visibility-value").textContent = `${visibility} m`;
    $("absorption-value").textContent = `${$("absorption").value} %`;
    $("asymmetry-value").textContent = asymmetry.toFixed(2);
    if (this.indoors) {
      $("light-gain-value").textContent = `${light_gain} ×`;
      $("shaft-gain-value").textContent = `${shaft_gain} ×`;
    } else $("top-value").textContent = `${top} m`;
  }
}
