/** Figures with their units: tabular, thin space, unit in a fainter ink. */

import { splitMass, splitReading, splitVolume, THIN } from "@/model/format";

export function Figure({ value, unit }: { value: string; unit: string }) {
  return (
    <span className="num">
      {value}
      {unit && (
        <>
          {THIN}
          <span className="u">{unit}</span>
        </>
      )}
    </span>
  );
}

export function Volume({ nl }: { nl: number }) {
  const [value, unit] = splitVolume(nl);
  return <Figure value={value} unit={unit} />;
}

/** How much of a lot there is: liquids by volume, solids and gases by mass. */
export function Amount({ nl, ug }: { nl: number; ug: number }) {
  const [value, unit] = nl === 0 && ug !== 0 ? splitMass(ug) : splitVolume(nl);
  return <Figure value={value} unit={unit} />;
}

export function ReadingValue(props: { value: number | string | boolean | null; unit: string }) {
  const [value, unit] = splitReading(props.value, props.unit);
  return <Figure value={value} unit={unit} />;
}

/** How full a vessel is. */
export function FillBar({ share }: { share: number | null }) {
  if (share === null) return <span className="cap unknown" title="Capacity not stated" />;
  return (
    <span className="cap" role="img" aria-label={`${Math.round(share * 100)} % full`}>
      <i style={{ width: `${share * 100}%` }} />
    </span>
  );
}

export function Progress({ share, look = "" }: { share: number; look?: "" | "sim" | "off" }) {
  return (
    <span
      className={`prog ${look}`}
      role="progressbar"
      aria-label="Done"
      aria-valuenow={Math.round(share * 100)}
    >
      <i style={{ width: `${Math.min(1, Math.max(0, share)) * 100}%` }} />
    </span>
  );
}
