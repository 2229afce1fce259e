import pickle,numpy as np,math,collections
R,H=pickle.load(open("/tmp/h-close/corpus.pkl","rb")); R2,H2=pickle.load(open("/tmp/h-close/sup.pkl","rb"))
# altitude
def std(h):
    T0,L,p0=288.15,.0065,101325.
    r=6356766.; g=h*r/(r+h)
    out=[]
    for z in (g,h):
        if z<11000: T=T0-L*z; p=p0*(T/T0)**5.25588
        elif z<20000: T=216.65; p=22632.06*math.exp(-(z-11000)/6341.62)
        else: T=216.65+.001*(z-20000); p=5474.89*(T/216.65)**-34.1632
        out.append((T,p))
    return out
u={"FT":(.3048,47.880259,1/1.8),"IN":(.0254,6894.757,1/1.8),"M":(1,1,1),"CM":(.01,1,1)}
seen=set();worst=collections.Counter();n=0;bad=[]
for f,ci,kind,dim,pin,vin,rn,v,fl,row in H+H2:
    if kind!="static" : continue
    key=(f,row)
    if key in seen: continue
    seen.add(key)
    h,p,T=v[1]*u[dim][0],v[3]*u[dim][1],v[4]*u[dim][2]
    if not all(map(math.isfinite,(h,p,T))) or pin: worst["skip",pin]+=1; continue
    n+=1
    (Tg,pg),(Th,ph)=std(h)
    e=(abs(T/Tg-1),abs(p/pg-1))
    if max(e)>2e-3: bad.append((f[-40:],ci,dim,rn,vin,h,round(T,2),round(Tg,2),round(p,1),round(pg,1),round(ph,1)))
print(n,worst,len(bad)); 
for b in bad[:25]: print(b)
